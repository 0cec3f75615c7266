"""Directions: the octahedral square is a bijection, reflection mirrors, normals face the camera."""

import math

import torch

from ringlight.core.directions import (
    directions_from_octahedral,
    normalize,
    octahedral_from_directions,
    reflect,
    shortest_axes,
    view_directions,
)
from ringlight.core.gaussians import Gaussians


def sphere(count: int = 500) -> torch.Tensor:
    return normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(3)))


def test_octahedral_round_trip():
    directions = sphere()
    uv = octahedral_from_directions(directions)
    assert uv.abs().max() <= 1
    assert torch.allclose(directions_from_octahedral(uv), directions, atol=1e-5)


def test_the_zero_vector_stays_finite():
    assert normalize(torch.zeros(1, 3)).tolist() == [[0.0, 0.0, 0.0]]
    assert octahedral_from_directions(torch.zeros(1, 3)).isfinite().all()


def test_reflection_keeps_length_and_flips_the_normal_part():
    normals, incoming = sphere(), sphere().flip(0)
    mirrored = reflect(incoming, normals)
    assert torch.allclose(mirrored.norm(dim=1), torch.ones(500), atol=1e-5)
    assert torch.allclose((mirrored * normals).sum(1), -(incoming * normals).sum(1), atol=1e-5)


def test_view_directions_point_from_the_camera():
    assert view_directions(torch.tensor([[0.0, 0.0, 5.0]]), torch.tensor([0.0, 0.0, 2.0])).tolist() == [[0.0, 0.0, 1.0]]


def test_the_shortest_axis_of_a_flat_disc_is_its_normal():
    half_turn = math.cos(math.pi / 4)  # 90 degrees about x: the z axis goes to -y
    disc = Gaussians(
        torch.zeros(1, 3),
        torch.tensor([[0.0, 0.0, -3.0]]),
        torch.tensor([[half_turn, half_turn, 0.0, 0.0]]),
        torch.zeros(1),
    )
    normal = shortest_axes(disc, torch.tensor([0.0, 7.0, 0.0]))
    assert torch.allclose(normal, torch.tensor([[0.0, 1.0, 0.0]]), atol=1e-6)
