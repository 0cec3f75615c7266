"""Ranks of a tensor train of a cubic grid. Torch-free: recipes work out sizes."""

from itertools import pairwise

AXES = 3

OCTANTS = 8
"""Entries of a core's mode: a bit of each axis."""


def ranks_of(payload: int, levels: int, most: int) -> tuple[int, ...]:
    """Left rank of each core and the right rank of the last: no more than either side of a cut has entries."""
    inner = (min(payload * OCTANTS**k, OCTANTS ** (levels - k), most) for k in range(1, levels))
    return (payload, *inner, 1)


def numbers_of(payload: int, levels: int, most: int) -> int:
    """Entries of all cores of such a train."""
    return sum(left * OCTANTS * right for left, right in pairwise(ranks_of(payload, levels, most)))
