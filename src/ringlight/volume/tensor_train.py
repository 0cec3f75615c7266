"""A grid as a quantised tensor train: one core for each bit of x, y and z.

Oseledets 2011; PuTT (Loeschcke, Wang, Leth-Espensen, Belongie, Kastoryano, Benaim, ICML 2024), section 3.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.volume.products import product
from ringlight.volume.tt_ranks import AXES, OCTANTS

Cores = Sequence[Float[Tensor, "_ _ _"]]
"""[left rank, octants, right rank] of each, from the coarsest level to the finest; the first one's left rank is the
payload's width, the last one's right rank 1. A core's octant is 4 x + 2 y + z for the bits of its level. Where the
first has four octants the grid has half the nodes along x, and where it has two, along y also."""


def spread_bits(side: int) -> Int[Tensor, "S"]:
    """Of 0 to ``side`` - 1: their bits, with two zeros after each."""
    numbers = torch.arange(side, dtype=torch.int32)
    spread = torch.zeros_like(numbers)
    for level in range(max(side - 1, 1).bit_length()):
        spread |= ((numbers >> level) & 1) << (AXES * level)
    return spread


def octant_path(nodes: Int[Tensor, "N 3"], levels: int) -> Int[Tensor, "N"]:
    """Numbers of nodes in Morton order: three bits a level, the coarsest first, those of x before y before z."""
    x, y, z = spread_bits(1 << levels)[nodes].unbind(-1)
    return (x << 2) | (y << 1) | z


def prefixes(cores: Cores) -> Float[Tensor, "r P s"]:
    """Products of matrices along all paths through the first cores, in Morton order."""
    found = cores[0]
    for core in cores[1:]:
        found = product(found.flatten(0, 1), core.flatten(1)).view(len(found), -1, core.shape[-1])
    return found


def suffixes(cores: Cores) -> Float[Tensor, "r P"]:
    """The same through the last cores."""
    found = cores[-1].flatten(1)
    for core in reversed(cores[:-1]):
        found = product(core.flatten(0, 1), found).view(len(core), -1)
    return found


def contracted(cores: Cores) -> Float[Tensor, "C M"]:
    """Every entry, nodes in Morton order."""
    half = len(cores) // 2
    if not half:
        return suffixes(cores)
    first = prefixes(cores[:half])
    return product(first.flatten(0, 1), suffixes(cores[half:])).view(len(first), -1)


def axes_of(core: Float[Tensor, "_ _ _"]) -> range:
    """Those of which a core holds a bit: the last ones."""
    return range(AXES - (core.shape[1].bit_length() - 1), AXES)


def grid_of(cores: Cores) -> Float[Tensor, "X Y Z C"]:
    """Every entry, by x, y and z."""
    bits = [(axis, level) for level, core in enumerate(cores) for axis in axes_of(core)]
    order = sorted(range(len(bits)), key=bits.__getitem__)
    dense = contracted(cores).view(-1, *[2] * len(bits)).permute(*(1 + k for k in order), 0)
    return dense.reshape(*(1 << sum(axis in axes_of(core) for core in cores) for axis in range(AXES)), len(cores[0]))


def gathered(cores: Cores, paths: Int[Tensor, "N"]) -> Float[Tensor, "N C"]:
    """Entries of single nodes, a product of matrices each: slow, and compared with what is fast."""
    row = torch.ones(len(paths), 1, 1).to(cores[0])
    for level, core in enumerate(reversed(list(cores))):
        octant = (paths >> (AXES * level)) & (OCTANTS - 1)
        row = core.transpose(0, 1)[octant & (core.shape[1] - 1)] @ row
    return row[..., 0]
