"""Where space is not empty, as bits: rays skip the rest."""

import torch
import torch.nn.functional
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from ringlight.core.kernel_limits import VOLUME_CELLS_A_BYTE as BITS
from ringlight.core.kernel_limits import VOLUME_MOST_CELLS as MOST_CELLS
from ringlight.volume.contract import Sides


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


def centers(cells: Sides) -> Float[Tensor, "N 3"]:
    """Of all cells, in the grid's [0, 1]^3, z fastest."""
    axes = [(torch.arange(count) + 0.5) / count for count in cells]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
