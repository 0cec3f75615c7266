"""The blocks of nodes that points touch, and where in them the nodes around a point lie.

A block is told by the first levels of a path. By the kernels where these run and no gradient of points is wanted; the
same in torch otherwise.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight import _kernels
from ringlight.volume.tt_bags import Bags
from ringlight.volume.tt_corners import CORNERS, corners_of
from ringlight.volume.tt_ranks import AXES, OCTANTS


@dataclass(frozen=True)
class Blocks:
    """``paths`` [B] of those with a node around a point, rising; ``slots`` [8^first]: the place of each among them, any
    for the others. Both are int32."""

    levels: int
    first: int
    paths: Int[Tensor, "B"]
    slots: Int[Tensor, "P"]

    @property
    def bits(self) -> int:
        """Of a path within a block."""
        return AXES * (self.levels - self.first)


@dataclass(frozen=True)
class Parts:
    """Of so many ``points``: one between blocks has a part in each. Block b has those from ``ends[b]`` to
    ``ends[b + 1]``, in the order of their points, ``owners``. Rows of ``bags`` are of one block; shares of nodes in
    another are zero."""

    points: int
    ends: Int[Tensor, "E"]
    owners: Int[Tensor, "Q"]
    bags: Bags


def whole(levels: int, device: torch.device, first_mode: int = OCTANTS) -> Blocks:
    """All entries: one block, or where the first core has fewer octants one of each of these, touched or not."""
    if first_mode == OCTANTS:
        zero = torch.zeros(1, dtype=torch.int32, device=device)
        return Blocks(levels, 0, zero, zero)
    octants = torch.arange(OCTANTS, dtype=torch.int32, device=device)
    # A node behind the last one of an axis without a bit here may be asked for; its share is zero.
    return Blocks(levels, 1, octants[:first_mode], octants & (first_mode - 1))


def blocks_of(points: Float[Tensor, "N 3"], levels: int, first: int) -> Blocks:
    """Told apart by the ``first`` levels."""
    touched = torch.zeros(OCTANTS**first, dtype=torch.int8, device=points.device)
    if _is_native(points):
        _kernels.train_touch(points.contiguous(), (levels, first), touched)
    else:
        touched[(corners_of(points, levels).paths >> AXES * (levels - first)).flatten().long()] = 1
    slots = (touched.cumsum(0, dtype=torch.int32) - 1).clamp_min(0)
    return Blocks(levels, first, touched.nonzero()[:, 0].int(), slots)


def corner_bags(points: Float[Tensor, "N 3"], blocks: Blocks) -> Bags:
    """Of each point its eight nodes, where blocks' entries follow each other."""
    if not _is_native(points):
        corners = corners_of(points, blocks.levels)
        slots = blocks.slots[(corners.paths >> blocks.bits).long()]
        return Bags((slots << blocks.bits) | _within(corners.paths, blocks), corners.shares)
    bags = _empty(len(points))
    _kernels.train_corners(
        points.contiguous(), (blocks.levels, blocks.first), blocks.slots, len(blocks.paths), (bags.index, bags.shares)
    )
    return bags


def parts_of(points: Float[Tensor, "N 3"], blocks: Blocks) -> Parts:
    """All of them."""
    if not _is_native(points):
        return _reference_parts(points, blocks)
    places, levels = points.contiguous(), (blocks.levels, blocks.first)
    ends = torch.zeros(len(blocks.paths) + 1, dtype=torch.int64)
    _kernels.train_count(places, levels, blocks.slots, ends[1:])
    ends = ends.cumsum(0)
    bags, owners = _empty(int(ends[-1])), torch.empty(int(ends[-1]), dtype=torch.int32)
    _kernels.train_parts(places, levels, blocks.slots, ends[:-1].clone(), owners, (bags.index, bags.shares))
    return Parts(len(points), ends, owners, bags)


def _reference_parts(points: Float[Tensor, "N 3"], blocks: Blocks) -> Parts:
    corners = corners_of(points, blocks.levels)
    slots = blocks.slots[(corners.paths >> blocks.bits).long()]
    new = torch.ones_like(slots, dtype=torch.bool)
    for corner in range(1, CORNERS):
        new[:, corner] = (slots[:, :corner] != slots[:, corner : corner + 1]).all(1)
    owner, first = new.nonzero(as_tuple=True)
    order = torch.argsort(slots[owner, first], stable=True)
    owner, first = owner[order], first[order]
    block = slots[owner, first]
    ends = torch.searchsorted(block, torch.arange(len(blocks.paths) + 1, device=block.device).to(block.dtype))
    shares = corners.shares[owner] * (slots[owner] == block[:, None])
    return Parts(len(points), ends, owner.int(), Bags(_within(corners.paths, blocks)[owner], shares))


def _within(paths: Int[Tensor, "*s"], blocks: Blocks) -> Int[Tensor, "*s"]:
    return paths & ((1 << blocks.bits) - 1)


def _empty(count: int) -> Bags:
    return Bags(torch.empty(count, CORNERS, dtype=torch.int32), torch.empty(count, CORNERS))


def _is_native(points: Tensor) -> bool:
    return points.is_cpu and points.dtype == torch.float32 and not points.requires_grad
