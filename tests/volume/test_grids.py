"""Nodes along the axes of a box: cubes, of which even a very long box has no more than kernels take."""

import torch
from hypothesis import given
from hypothesis import strategies as some

from ringlight.volume.grids import FEWEST_NODES, MOST_NODES, nodes_around, sides_of

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


SHARES = some.floats(-0.3, 1.3)


@given(some.tuples(SHARES, SHARES, SHARES), some.tuples(SHARES, SHARES, SHARES), some.integers(1, 300))
def test_nodes_around_a_box_enclose_what_of_it_lies_in_the_grid(one, other, last: int):
    grid = torch.tensor([[-1.0, -2.0, 0.5], [3.0, 1.0, 0.75]])
    low, high = grid
    box = low + torch.stack([torch.tensor(one).minimum(torch.tensor(other)),
                             torch.tensor(one).maximum(torch.tensor(other))]) * (high - low)  # fmt: skip
    ends = nodes_around(grid, box, (last + 1,) * 3, torch.full((3,), float(last)))
    assert (ends[0] >= 0).all()
    assert (ends[1] <= last).all()
    assert (ends[1] > ends[0]).all()
    first, final = low + ends / last * (high - low)
    inside = box.clamp(low, high)
    assert (first <= inside[0] + 1e-5).all()
    assert (final >= inside[1] - 1e-5).all()
