"""Axes along which a box is so long that a grid takes twice the nodes there. Torch-free: recipes ask."""

from ringlight.methods.volume_recipe import Bounds

LONG = 1.5
"""Times the box's shortest side: the middle between as long and twice as long."""


def long_axes(bounds: Bounds) -> tuple[int, ...]:
    """Those of x, y and z, as 0, 1 and 2; never all of them."""
    lengths = [high - low for low, high in zip(bounds[:3], bounds[3:], strict=True)]
    return tuple(axis for axis, length in enumerate(lengths) if length >= LONG * min(lengths))


def grid_in_words(side: int, long: tuple[int, ...]) -> str:
    """One of ``side`` nodes along each axis, and twice as many along ``long`` ones."""
    if not long:
        return f"{side} cubed"
    x, y, z = (side << (axis in long) for axis in range(3))
    return f"{x} x {y} x {z}"
