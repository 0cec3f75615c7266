"""Planes of a picture, and the same pixels tile by tile and block by block, as the compiled rasterizer keeps them."""

import torch
from jaxtyping import Int32, Int64, Shaped
from torch import Tensor

from ringlight.core.kernel_limits import BLOCK, TILE

ACROSS = TILE // BLOCK
"""Blocks across a tile."""


def tiles_from_planes(planes: Shaped[Tensor, "D H W"]) -> Shaped[Tensor, "D Q"]:
    """Q pixels, those of the last tiles that lie beyond the picture as well: 0 there."""
    depth, height, width = planes.shape
    rows, columns = -(-height // TILE), -(-width // TILE)
    padded = torch.nn.functional.pad(planes, (0, columns * TILE - width, 0, rows * TILE - height))
    blocks = padded.view(depth, rows, ACROSS, BLOCK, columns, ACROSS, BLOCK)
    return blocks.permute(0, 1, 4, 2, 5, 3, 6).reshape(depth, -1)


def planes_from_tiles(tiles: Shaped[Tensor, "D Q"], height: int, width: int) -> Shaped[Tensor, "D H W"]:
    """Inverse of :func:`tiles_from_planes`."""
    rows, columns = -(-height // TILE), -(-width // TILE)
    blocks = tiles.view(-1, rows, columns, ACROSS, ACROSS, BLOCK, BLOCK).permute(0, 1, 3, 5, 2, 4, 6)
    return blocks.reshape(-1, rows * TILE, columns * TILE)[:, :height, :width]


def tile_by_tile(pixels: Int64[Tensor, "P"], height: int, width: int) -> Int64[Tensor, "P"]:
    """The order in which ``pixels``, numbers that count row by row, follow one another in tiles."""
    numbers = torch.arange(1, height * width + 1, device=pixels.device).view(1, height, width)
    in_tiles = tiles_from_planes(numbers)[0]
    place = torch.empty_like(numbers.flatten())
    place[in_tiles[in_tiles > 0] - 1] = torch.arange(height * width, device=pixels.device)
    return place[pixels].argsort()


def in_drawn_blocks(drawn: Int32[Tensor, "B"]) -> Tensor:
    """Of every pixel of B blocks, whether any of its block was drawn, [Q] bool; ``drawn`` are bits of pixels."""
    return (drawn != 0).repeat_interleave(BLOCK * BLOCK)
