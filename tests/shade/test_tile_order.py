"""Pixels tile by tile: nothing is lost, and they lie where the compiled rasterizer puts them."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.core.kernel_limits import BLOCK, TILE
from ringlight.shade.tile_order import in_drawn_blocks, planes_from_tiles, tile_by_tile, tiles_from_planes

sides = st.integers(1, 2 * TILE + 3)


@given(sides, sides)
def test_there_and_back_nothing_is_lost(height: int, width: int):
    planes = torch.arange(2 * height * width, dtype=torch.float32).view(2, height, width)
    tiles = tiles_from_planes(planes)
    assert tiles.shape[1:] == (2, BLOCK**2)
    assert len(tiles) % (TILE // BLOCK) ** 2 == 0
    assert torch.equal(planes_from_tiles(tiles, height, width), planes)
    assert tiles.count_nonzero() == planes.count_nonzero()


@given(sides, sides, st.data())
def test_a_pixel_lies_in_its_block_of_its_tile(height: int, width: int, data: st.DataObject):
    y, x = data.draw(st.integers(0, height - 1)), data.draw(st.integers(0, width - 1))
    planes = torch.zeros(1, height, width)
    planes[0, y, x] = 1
    tile = y // TILE * -(-width // TILE) + x // TILE
    block = y % TILE // BLOCK * (TILE // BLOCK) + x % TILE // BLOCK
    place = tile * TILE**2 + block * BLOCK**2 + y % BLOCK * BLOCK + x % BLOCK
    assert tiles_from_planes(planes).flatten().nonzero().flatten().tolist() == [place]


@given(sides, sides, st.integers(0, 2**31))
def test_numbers_of_pixels_are_sorted_as_tiles_hold_them(height: int, width: int, seed: int):
    some = torch.rand(height, width, generator=torch.Generator().manual_seed(seed)) < 0.5
    numbers = some.flatten().nonzero()[:, 0]
    expected = tiles_from_planes(torch.arange(height * width).view(1, height, width) + 1).flatten() - 1
    expected = expected[tiles_from_planes(some[None].float()).flatten() > 0]
    assert torch.equal(numbers[tile_by_tile(numbers, height, width)], expected)


def test_a_block_counts_as_drawn_if_any_of_its_pixels_was():
    found = in_drawn_blocks(torch.tensor([0, 1, 0, -(2**31)], dtype=torch.int32))
    assert found.view(4, -1).float().mean(1).tolist() == [0, 1, 0, 1]
