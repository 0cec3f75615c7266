"""Flags that make a training run of these tests a matter of a second."""

QUICK = ("--steps", "40", "--quiet", "--lpips", "--initial-points", "300")
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
