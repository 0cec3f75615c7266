"""Nodes along the axes of a box: cubes, of which even a very long box has no more than kernels take."""

import torch
from hypothesis import given
from hypothesis import strategies as some

from ringlight.volume.grids import FEWEST_NODES, MOST_NODES, sides_of

LENGTHS = some.floats(1e-3, 1e3)


@given(LENGTHS, LENGTHS, LENGTHS, some.integers(2, 600))
def test_sides_are_within_what_kernels_take(x: float, y: float, z: float, side: int):
    lengths = torch.tensor([x, y, z])
    sides = sides_of(torch.stack([-lengths, lengths]), side**3)
    assert all(FEWEST_NODES <= nodes <= MOST_NODES for nodes in sides)
    pitch = float((2 * lengths.double()).prod() / side**3) ** (1 / 3)
    for nodes, length in zip(sides, lengths.tolist(), strict=True):
        wanted = 2 * length / pitch
        assert nodes in (FEWEST_NODES, MOST_NODES) or abs(nodes - wanted) <= 1 + 1e-5 * wanted
