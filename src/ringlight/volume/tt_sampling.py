"""A tensor train's values between its nodes: of the whole grid, of the blocks that points touch, or of points alone.

All three give the same numbers, of one point or more. ``from_grid`` contracts every entry (PuTT's way).
``from_blocks`` contracts the first cores for the blocks of nodes that have a point in them, and all entries of these.
``from_points`` never writes entries down: what the last cores make of a point's corners is interpolated first, and
meets the matrix of the first ones after that.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.volume.grouped_product import grouped_product
from ringlight.volume.tensor_train import Cores, contracted, suffixes
from ringlight.volume.tt_corners import CORNERS, Corners
from ringlight.volume.tt_ranks import AXES, OCTANTS


def from_grid(cores: Cores, corners: Corners) -> Float[Tensor, "N C"]:
    """By all entries of the grid."""
    return _interpolated(contracted(cores).T.contiguous(), corners.paths, corners.shares)


def from_blocks(cores: Cores, corners: Corners, first: int) -> Float[Tensor, "N C"]:
    """By the entries of blocks that the ``first`` cores tell apart."""
    blocks, slots, inner = _blocks_of(corners, len(cores), first)
    before, after = some_prefixes(cores[:first], blocks), suffixes(cores[first:])
    width = before.shape[1]
    entries = before.flatten(0, 1) @ after
    rows = entries.view(len(blocks), width, -1).transpose(1, 2).reshape(-1, width)
    return _interpolated(rows, slots * after.shape[1] + inner, corners.shares)


def from_points(cores: Cores, corners: Corners, first: int) -> Float[Tensor, "N C"]:
    """By what the cores after the ``first`` make of each point. A point between blocks is taken by parts, a block
    each."""
    blocks, slots, inner = _blocks_of(corners, len(cores), first)
    before, after = some_prefixes(cores[:first], blocks), suffixes(cores[first:]).T.contiguous()
    part, owner = _parts(slots)
    order = torch.argsort(slots[part, owner], stable=True)
    part, owner = part[order], owner[order]
    block = slots[part, owner]
    of_part = slots[part] == block[:, None]
    # Corners of one point that lie in one block are seen by the first of them.
    rows = _interpolated(after, inner[part], corners.shares[part] * of_part)
    ends = torch.searchsorted(block, torch.arange(len(blocks) + 1, device=block.device).to(block.dtype))
    found = grouped_product(rows, before, ends)
    return found.new_zeros(len(corners.paths), found.shape[-1]).index_add(0, part, found)


def some_prefixes(cores: Cores, paths: Int[Tensor, "B"]) -> Float[Tensor, "B C s"]:
    """Products of the matrices along these paths, which rise, through all of these cores."""
    if len(cores) == 1:
        return cores[0][:, paths.long()].transpose(0, 1)
    parents, place = torch.unique_consecutive(paths >> AXES, return_inverse=True)
    above = some_prefixes(cores[:-1], parents)
    octants = paths & (OCTANTS - 1)
    chosen = [(octants == octant).nonzero()[:, 0] for octant in range(OCTANTS)]
    products = [above[place[rows]] @ cores[-1][:, octant] for octant, rows in enumerate(chosen)]
    return torch.cat(products)[torch.argsort(torch.cat(chosen))]


def _blocks_of(corners: Corners, levels: int, first: int) -> tuple[Tensor, Tensor, Tensor]:
    """Paths of the blocks that have a corner in them, rising; which of these each corner is in, and its path there."""
    bits = AXES * (levels - first)
    block = corners.paths >> bits
    touched = torch.zeros(OCTANTS**first, dtype=torch.int32, device=block.device)
    touched[block.flatten().long()] = 1
    slots = (touched.cumsum(0, dtype=torch.int32) - 1)[block.long()]
    return touched.nonzero()[:, 0].int(), slots, corners.paths & ((1 << bits) - 1)


def _parts(slots: Int[Tensor, "N 8"]) -> tuple[Int[Tensor, "Q"], Int[Tensor, "Q"]]:
    """Points, and the first corner of each that lies in another block than those before it."""
    new = torch.ones_like(slots, dtype=torch.bool)
    for corner in range(1, CORNERS):
        new[:, corner] = (slots[:, :corner] != slots[:, corner : corner + 1]).all(1)
    point, first = new.nonzero(as_tuple=True)
    return point, first


def _interpolated(
    rows: Float[Tensor, "M C"], index: Int[Tensor, "N 8"], shares: Float[Tensor, "N 8"]
) -> Float[Tensor, "N C"]:
    """Sums of eight rows each, times their shares."""
    if rows.shape[1] == 1:
        # The way back of indexing adds in any order; that of this adds in theirs.
        corners = rows[:, 0].index_select(0, index.flatten()).view_as(index)
        return (corners * shares).sum(-1, keepdim=True)
    return torch.nn.functional.embedding_bag(index.long(), rows, mode="sum", per_sample_weights=shares)
