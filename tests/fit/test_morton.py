"""Morton order is a permutation that keeps neighbours together."""

import torch

from ringlight.fit.strategies.morton import morton_order


def test_the_corners_of_a_cube_follow_the_z_curve():
    corners = torch.tensor([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=torch.float32)
    ordered = corners[morton_order(corners)]
    assert ordered.tolist() == [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]


def test_it_is_a_permutation_even_of_equal_points():
    points = torch.zeros(17, 3)
    assert morton_order(points).tolist() == list(range(17))


def test_neighbours_in_the_order_are_near_in_space():
    points = torch.rand(4096, 3, generator=torch.Generator().manual_seed(0))
    step = (points[1:] - points[:-1]).norm(dim=1).mean()
    ordered = points[morton_order(points)]
    assert (ordered[1:] - ordered[:-1]).norm(dim=1).mean() < 0.25 * step
