"""How fast the network of a volume learns."""

NETWORK_RATE = 4e-3
"""Four times that of the papers. Held-out views gain 0.25 to 0.5 dB by it after 3,000 steps at a quarter of the size,
for no time, once it rises at first (docs/experiments/putt.md)."""

NETWORK_WARM_UP, MOST_WARM_UP = 200, 1 / 15
"""Steps, and share of a run, over which a network's rate rises: twice as long as one of 256 units needed, which at its
full rate shows black; 40 of 600 steps kept a fast one from it (docs/experiments/putt.md)."""


def rising_share(asked: float | None, steps: int) -> float:
    """Share of a run of so many steps over which the network's rate rises: the one that is asked for, or the
    default."""
    return min(NETWORK_WARM_UP / max(steps, 1), MOST_WARM_UP) if asked is None else asked
