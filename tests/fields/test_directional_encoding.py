"""Integrated directional encoding: the harmonics that they are. Its kernel: color/test_illuminated.py."""

import torch
from torch import Tensor

from ringlight.core.directions import normalize
from ringlight.fields.directional_encoding import LEVELS, ORDERS, directional_encoding

SPHERE = 20_000


def directions(count: int, seed: int) -> Tensor:
    return normalize(torch.randn(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)))


def even_directions(count: int) -> Tensor:
    """Evenly spread over the sphere (a Fibonacci spiral)."""
    number = torch.arange(count, dtype=torch.float64) + 0.5
    z, angle = 1 - 2 * number / count, number * torch.pi * (3 - 5**0.5)
    around = (1 - z * z).sqrt()
    return torch.stack([around * angle.cos(), around * angle.sin(), z], -1)


def test_they_are_orthonormal_harmonics():
    code = directional_encoding(even_directions(SPHERE), torch.zeros(SPHERE, dtype=torch.float64))
    harmonics = torch.complex(code[:, : len(ORDERS)], code[:, len(ORDERS) :])
    products = harmonics.T @ harmonics.conj() * (4 * torch.pi / SPHERE)
    torch.testing.assert_close(products, torch.eye(len(ORDERS), dtype=products.dtype), rtol=0, atol=2e-3)


def test_the_power_of_a_level_is_the_same_for_all_directions_and_fades_as_the_paper_says():
    """Unsoeld's theorem: the squares of all orders add up to (2 l + 1) / (4 pi)."""
    rough = torch.full((50,), 0.3, dtype=torch.float64)
    squares = directional_encoding(directions(50, 0), rough).square().view(50, 2, -1).sum(1)
    for level in LEVELS:
        own = [i for i, (of, _) in enumerate(ORDERS) if of == level]
        power = squares[:, own[0]] + 2 * squares[:, own[1:]].sum(-1)
        expected = (2 * level + 1) / (4 * torch.pi) * torch.exp(-rough * level * (level + 1))
        torch.testing.assert_close(power, expected)
