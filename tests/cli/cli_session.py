"""Flags that make a training run of these tests a matter of a second."""

QUICK = tuple(
    [
        "--steps",
        "40",
        "--quiet",
        "--lpips",
        "--initial-points",
        "300",
        "--densify.begin",
        "5",
        "--densify.every",
        "5",
        "--densify.stop",
        "0.8",
        "--densify.reset-every",
        "12",
        "--densify.threshold",
        "1e-5",
    ]
)
"""Everything that changes the table happens in these steps: cloning, splitting, pruning, the opacity reset."""

SMALL_LIGHT = (
    "--light.ring.rank",
    "4",
    "--light.ring.features",
    "8",
    "--light.ring.position-nodes",
    "64",
    "--light.ring.head-hidden",
    "16",
    "--warmup",
    "0.3",
)
