"""Flags that make a training run of these tests a matter of a second."""


def flags(**values: object) -> tuple[str, ...]:
    """``densify__every=5`` becomes ``--densify.every 5``."""
    return tuple(
        word
        for name, value in values.items()
        for word in (f"--{name.replace('__', '.').replace('_', '-')}", str(value))
    )


QUICK = (
    *flags(steps=40, initial_points=300, densify__begin=5, densify__every=5, densify__stop=0.8),
    *flags(densify__reset_every=12, densify__threshold=1e-5),
    "--quiet",
    "--lpips",
)
"""Everything that changes the table happens in these steps: cloning, splitting, pruning, the opacity reset."""

SMALL_LIGHT = (
    *flags(light__ring__rank=4, light__ring__features=8, light__ring__position_nodes=64),
    *flags(light__ring__head_hidden=16, warmup=0.3),
)
