"""A grid as a quantised tensor train: one core for each bit of x, y and z.

Oseledets 2011; PuTT (Loeschcke, Wang, Leth-Espensen, Belongie, Kastoryano, Benaim, ICML 2024), section 3.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

Cores = Sequence[Float[Tensor, "_ _ _"]]
"""[left rank, octants, right rank] of each, from the coarsest level to the finest; the first one's left rank is the
payload's width, the last one's right rank 1. A core's octant is 4 x + 2 y + z for the bits of its level."""

OCTANTS = 8
AXES = 3


def ranks_of(payload: int, levels: int, most: int) -> tuple[int, ...]:
    """Left rank of each core and the right rank of the last: no more than either side of a cut has entries."""
    inner = (min(payload * OCTANTS**k, OCTANTS ** (levels - k), most) for k in range(1, levels))
    return (payload, *inner, 1)


def numbers_of(payload: int, levels: int, most: int) -> int:
    """Entries of all cores of such a train."""
    ranks = ranks_of(payload, levels, most)
    return sum(left * OCTANTS * right for left, right in zip(ranks, ranks[1:], strict=False))


def octant_path(nodes: Int[Tensor, "N 3"], levels: int) -> Int[Tensor, "N"]:
    """Numbers of nodes in Morton order: three bits a level, the coarsest first, those of x before y before z."""
    path = torch.zeros_like(nodes[:, 0])
    for level in range(levels):
        for axis in range(AXES):
            bit = (nodes[:, axis] >> level) & 1
            path |= bit << (AXES * level + AXES - 1 - axis)
    return path


def prefixes(cores: Cores) -> Float[Tensor, "r P s"]:
    """Products of matrices along all paths through the first cores, in Morton order."""
    product = cores[0]
    for core in cores[1:]:
        product = (product.flatten(0, 1) @ core.flatten(1)).view(len(product), -1, core.shape[-1])
    return product


def suffixes(cores: Cores) -> Float[Tensor, "r P"]:
    """The same through the last cores."""
    product = cores[-1].flatten(1)
    for core in reversed(cores[:-1]):
        product = (core.flatten(0, 1) @ product).view(len(core), -1)
    return product


def contracted(cores: Cores) -> Float[Tensor, "C M"]:
    """Every entry, nodes in Morton order."""
    half = len(cores) // 2
    if not half:
        return suffixes(cores)
    first = prefixes(cores[:half])
    return (first.flatten(0, 1) @ suffixes(cores[half:])).view(len(first), -1)


def grid_of(cores: Cores) -> Float[Tensor, "S S S C"]:
    """Every entry, by x, y and z."""
    levels, width = len(cores), len(cores[0])
    axes = [1 + AXES * level + axis for axis in range(AXES) for level in range(levels)]
    dense = contracted(cores).view(width, *[2] * (AXES * levels)).permute(*axes, 0)
    return dense.reshape(*[1 << levels] * AXES, width)


def gathered(cores: Cores, paths: Int[Tensor, "N"]) -> Float[Tensor, "N C"]:
    """Entries of single nodes, a product of matrices each: slow, and compared with what is fast."""
    row = torch.ones(len(paths), 1, 1).to(cores[0])
    for level, core in enumerate(reversed(list(cores))):
        octant = (paths >> (AXES * level)) & (OCTANTS - 1)
        row = core.transpose(0, 1)[octant] @ row
    return row[..., 0]
