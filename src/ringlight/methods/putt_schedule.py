"""When putt's grid doubles, and when it looks for empty space: shares of a run. Torch-free: recipes ask."""

REFINED = (250, 500, 2000, 4000, 6000, 8000, 10_000, 12_000)
"""Steps of a run of 30,000 after which the grid is refined; the paper doubles it four times."""

PAPER_DOUBLINGS = 4

LAST_DOUBLING = 1 / 3
"""At a quarter of the size held-out views of one scene show as much as with the paper's share, 2/15, in four fifths of
the time; after half a run they show 0.15 dB less (docs/experiments/putt.md)."""

LATEST_DOUBLING = 0.75
"""What rounded trains lose has to be learned again before models are averaged, or before rates settle, as they do over
a run's last fifth."""

EMPTY_AT, EARLY = (0.45, 0.55), (1 / 15, 2 / 15)
"""Shares of a run after which empty space is found: once what the last doubling shows is learned, since what is not
learned yet looks empty (docs/experiments/putt.md); and as early as TensoRF finds it."""


def doublings(times: int, last_share: float, paper_steps: int) -> tuple[float, ...]:
    """Steps of the paper's run after which so many doublings come: fewer than the paper's are its last ones, and the
    last comes no earlier than after ``last_share`` of the run."""
    of_paper = REFINED[max(PAPER_DOUBLINGS - times, 0) :][:times]
    return (*of_paper[:-1], *(max(step, last_share * paper_steps) for step in of_paper[-1:]))
