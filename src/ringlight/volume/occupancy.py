"""Where space is not empty, as bits: rays skip the rest."""

from typing import NamedTuple

import torch
import torch.nn.functional
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from ringlight.core.kernel_limits import VOLUME_CELLS_A_BYTE as BITS
from ringlight.core.kernel_limits import VOLUME_MOST_CELLS as MOST_CELLS
from ringlight.volume.contract import Sides

ROUNDING = 1e-4
"""Of a cell: edges that lie no further apart are the same."""


def cells_of(box: Float[Tensor, "2 3"], nodes: int) -> Sides:
    """Cells along each axis, those along z a multiple of eight; no more than a grid has ``nodes`` along the longest."""
    lengths = (box[1] - box[0]).double()
    x, y, z = (max(round(min(MOST_CELLS, nodes) * share), 1) for share in (lengths / lengths.max()).tolist())
    return x, y, -(-z // BITS) * BITS


def everything() -> UInt8[Tensor, "1 1 1"]:
    """Nothing is known to be empty."""
    return torch.full((1, 1, 1), 255, dtype=torch.uint8)


def packed(flags: Bool[Tensor, "*C Z"]) -> UInt8[Tensor, "*C B"]:
    """Eight along the last axis, cells along z, a byte, the first one the lowest bit. Never a wider number each: flags
    of rays are many."""
    weights = 2 ** torch.arange(BITS, dtype=torch.uint8, device=flags.device)
    return (flags.unflatten(-1, (-1, BITS)).to(torch.uint8) * weights).sum(-1, dtype=torch.uint8)


def unpacked(bits: UInt8[Tensor, "*C B"]) -> Bool[Tensor, "*C Z"]:
    """Inverse of :func:`packed`."""
    return ((bits[..., None] >> torch.arange(BITS, dtype=torch.uint8, device=bits.device)) & 1).bool().flatten(-2)


def is_occupied(bits: UInt8[Tensor, "X Y B"], places: Float[Tensor, "N 3"]) -> Bool[Tensor, "N"]:
    """Of points in the grid's own [0, 1]^3; those beyond it take the nearest cell."""
    x, y, z = (
        (places[:, axis] * count).long().clamp(0, count - 1)
        for axis, count in enumerate((*bits.shape[:2], BITS * bits.shape[2]))
    )
    return ((bits[x, y, z // BITS].long() >> (z % BITS)) & 1).bool()


def widened(occupied: Bool[Tensor, "X Y Z"]) -> Bool[Tensor, "X Y Z"]:
    """With the neighbours of each cell, 27 of them with itself."""
    return torch.nn.functional.max_pool3d(occupied[None, None].float(), 3, 1, 1)[0, 0] > 0


def box_of(occupied: Bool[Tensor, "X Y Z"], box: Float[Tensor, "2 3"]) -> Float[Tensor, "2 3"]:
    """That of the occupied cells of ``box``, of which there are some."""
    cells, at = torch.tensor(occupied.shape).to(box), occupied.nonzero()
    return box[0] + torch.stack([at.amin(0) / cells, (at.amax(0) + 1) / cells]) * (box[1] - box[0])


def centers(cells: Sides) -> Float[Tensor, "N 3"]:
    """Of all cells, in the grid's [0, 1]^3, z fastest."""
    axes = [(torch.arange(count) + 0.5) / count for count in cells]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


class Carving(NamedTuple):
    """``left``: cells over ``box``, world units, that photographs do not show to be empty."""

    box: Float[Tensor, "2 3"]
    left: Bool[Tensor, "X Y Z"]

    def met_by(self, box: Float[Tensor, "2 3"], cells: Sides) -> Bool[Tensor, "X Y Z"]:
        """Of cells of another ``box`` those that meet one that is left."""
        found = self.left
        for axis, count in enumerate(cells):
            low, high = box[:, axis].tolist()
            first, last = self.box[:, axis].tolist()
            edges = low + (high - low) / count * torch.arange(count + 1, dtype=torch.float64)
            at = (edges - first) / (last - first) * found.shape[axis]
            begins = (at[:-1] + ROUNDING).floor().long().clamp(0, found.shape[axis])
            ends = (at[1:] - ROUNDING).ceil().long().clamp(0, found.shape[axis])
            before = found.cumsum(axis).movedim(axis, 0)
            before = torch.cat([torch.zeros_like(before[:1]), before])
            found = (before[ends] > before[begins]).movedim(0, axis)
        return found
