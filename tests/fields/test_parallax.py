"""Rays leave the sphere where geometry says."""

import math

import torch

from ringlight.core.directions import normalize
from ringlight.fields.parallax import sphere_exits


def sphere(radius: float, *center: float) -> torch.Tensor:
    return torch.tensor([*(center or (0.0, 0.0, 0.0)), -math.log(radius)], dtype=torch.float64)


def test_exits_lie_on_the_sphere_and_on_the_ray():
    torch.manual_seed(0)
    points = torch.randn(100, 3, dtype=torch.float64) * 0.3
    rays = normalize(torch.randn(100, 3, dtype=torch.float64))
    at = sphere(2.0, 0.1, -0.2, 0.3)
    exits = sphere_exits(points, rays, at)
    torch.testing.assert_close(exits.norm(dim=-1), torch.ones(100, dtype=torch.float64))
    travelled = exits * 2 + at[:3] - points
    torch.testing.assert_close(normalize(travelled), rays)


def test_a_huge_sphere_is_infinitely_far_away():
    points, rays = torch.randn(50, 3), normalize(torch.randn(50, 3))
    torch.testing.assert_close(sphere_exits(points, rays, sphere(1e5).float()), rays, rtol=0, atol=1e-4)


def test_a_ray_that_passes_by_takes_its_nearest_point():
    exits = sphere_exits(torch.tensor([[-5.0, 3.0, 0.0]]), torch.tensor([[1.0, 0.0, 0.0]]), sphere(1.0).float())
    torch.testing.assert_close(exits, torch.tensor([[0.0, 3.0, 0.0]]), rtol=0, atol=2e-3)


def test_gradients():
    torch.manual_seed(1)
    points = (torch.randn(20, 3, dtype=torch.float64) * 0.3).requires_grad_()
    rays = normalize(torch.randn(20, 3, dtype=torch.float64)).requires_grad_()
    at = sphere(1.5, 0.1, 0.2, 0.0).requires_grad_()
    assert torch.autograd.gradcheck(sphere_exits, (points, rays, at))
