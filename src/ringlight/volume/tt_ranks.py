"""Ranks of a tensor train. Torch-free: recipes work out sizes."""

from itertools import pairwise

AXES = 3

OCTANTS = 8
"""Entries of a core's mode: a bit of each axis. The first core has as many, or 4 or 2: bits of the last axes alone,
which have twice the nodes of the others."""


def ranks_of(payload: int, levels: int, most: int, first: int = OCTANTS) -> tuple[int, ...]:
    """Left rank of each core and the right rank of the last: no more than either side of a cut has entries. ``first``
    are the entries of the first core's mode."""
    inner = (min(payload * first * OCTANTS ** (k - 1), OCTANTS ** (levels - k), most) for k in range(1, levels))
    return (payload, *inner, 1)


def modes_of(levels: int, first: int = OCTANTS) -> tuple[int, ...]:
    """Entries of each core's mode."""
    return (first, *[OCTANTS] * (levels - 1))


def numbers_of(payload: int, levels: int, most: int, first: int = OCTANTS) -> int:
    """Entries of all cores of such a train."""
    ranks = pairwise(ranks_of(payload, levels, most, first))
    return sum(left * mode * right for (left, right), mode in zip(ranks, modes_of(levels, first), strict=True))
