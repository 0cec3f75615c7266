"""How fast putt's trains learn: by the length of a run. Torch-free: recipes ask."""

LAST_RATE = 0.2
"""Share of a learning rate that is left after a whole run, if nothing sets it back. What Adam's steps add to all
matrices of a product is noise; a mean of models is without it, and rates need to fall less
(docs/experiments/putt.md)."""

SETTLING_RATE, SETTLED_RATE = 0.07, 0.01
"""Where no models are averaged: share of a rate after a run, and after a faster fall over its last fifth, by which that
noise settles."""

PAPER_STEPS, PAPER_RATE = 80_000, 8e-4
"""Length of the paper's run, and its rate of the trains. Shorter runs with that rate hardly begin to learn."""

FASTER, FAST = 2.0, 8e-3
"""Times that rate as long as it is no higher than the second; that gained 0.15 dB in 3,000 steps. Of two
runs of 15,000 the one at less than half of it had 0.36 dB less. In runs of 1,000 steps as fast ones learn less
(docs/experiments/putt.md)."""

HIGHEST_RATE = 0.03
"""With twice as much a run of 150 steps on the bundled toaster learned less."""


def trains_rate(steps: int) -> float:
    """At the start of a run of so many steps."""
    rate = PAPER_RATE * (PAPER_STEPS / max(steps, 1)) ** 0.5
    return min(max(min(FASTER * rate, FAST), rate), HIGHEST_RATE)
