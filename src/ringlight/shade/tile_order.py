"""Planes of a picture, and the same pixels tile by tile and block by block, as the compiled rasterizer keeps them.

A block holds its sixteen pixels channel by channel, so that what is known of a pixel lies in one run of memory.
"""

import torch
from jaxtyping import Bool, Int32, Int64, Shaped
from torch import Tensor

from ringlight.core.kernel_limits import BLOCK, TILE

ACROSS = TILE // BLOCK
"""Blocks across a tile."""


def tiles_from_planes(planes: Shaped[Tensor, "D H W"]) -> Shaped[Tensor, "B D 16"]:
    """B blocks, those of the last tiles that lie beyond the picture as well: 0 there."""
    depth, height, width = planes.shape
    rows, columns = -(-height // TILE), -(-width // TILE)
    padded = torch.nn.functional.pad(planes, (0, columns * TILE - width, 0, rows * TILE - height))
    blocks = padded.view(depth, rows, ACROSS, BLOCK, columns, ACROSS, BLOCK)
    return blocks.permute(1, 4, 2, 5, 0, 3, 6).reshape(-1, depth, BLOCK * BLOCK)


def planes_from_tiles(tiles: Shaped[Tensor, "B D 16"], height: int, width: int) -> Shaped[Tensor, "D H W"]:
    """Inverse of :func:`tiles_from_planes`."""
    rows, columns = -(-height // TILE), -(-width // TILE)
    blocks = tiles.view(rows, columns, ACROSS, ACROSS, -1, BLOCK, BLOCK).permute(4, 0, 2, 5, 1, 3, 6)
    return blocks.reshape(-1, rows * TILE, columns * TILE)[:, :height, :width]


def tile_by_tile(pixels: Int64[Tensor, "P"], height: int, width: int) -> Int64[Tensor, "P"]:
    """The order in which ``pixels``, numbers that count row by row, follow one another in tiles."""
    numbers = torch.arange(1, height * width + 1, device=pixels.device).view(1, height, width)
    in_tiles = tiles_from_planes(numbers).flatten()
    place = torch.empty_like(numbers.flatten())
    place[in_tiles[in_tiles > 0] - 1] = torch.arange(height * width, device=pixels.device)
    return place[pixels].argsort()


def in_drawn_blocks(drawn: Int32[Tensor, "B"]) -> Bool[Tensor, "B 1 1"]:
    """Of every block whether any of its pixels was drawn; ``drawn`` are bits of pixels."""
    return (drawn != 0)[:, None, None]
