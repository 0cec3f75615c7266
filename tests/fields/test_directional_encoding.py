"""Integrated directional encoding: the harmonics that they are, and the kernel against torch."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.fields.directional_encoding import (
    CODE_WIDTH,
    LEVELS,
    ORDERS,
    directional_encoding_reference,
    write_directional_encoding,
)

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
    code = directional_encoding_reference(even_directions(SPHERE), torch.zeros(SPHERE, dtype=torch.float64))
    harmonics = torch.complex(code[:, : len(ORDERS)], code[:, len(ORDERS) :])
    products = harmonics.T @ harmonics.conj() * (4 * torch.pi / SPHERE)
    torch.testing.assert_close(products, torch.eye(len(ORDERS), dtype=products.dtype), rtol=0, atol=2e-3)


def test_the_power_of_a_level_is_the_same_for_all_directions_and_fades_as_the_paper_says():
    """Unsoeld's theorem: the squares of all orders add up to (2 l + 1) / (4 pi)."""
    rough = torch.full((50,), 0.3, dtype=torch.float64)
    squares = directional_encoding_reference(directions(50, 0), rough).square().view(50, 2, -1).sum(1)
    for level in LEVELS:
        own = [i for i, (of, _) in enumerate(ORDERS) if of == level]
        power = squares[:, own[0]] + 2 * squares[:, own[1:]].sum(-1)
        expected = (2 * level + 1) / (4 * torch.pi) * torch.exp(-rough * level * (level + 1))
        torch.testing.assert_close(power, expected)


@settings(max_examples=25, derandomize=True, deadline=None)
@given(count=st.integers(0, 70), before=st.integers(0, 20), after=st.integers(0, 20), seed=st.integers(0, 10_000))
def test_kernel_equals_torch_and_writes_its_own_columns_alone(count, before, after, seed):
    at = directions(count, seed)
    roughness = torch.rand(count, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)) * 3
    rows = torch.full((count, before + CODE_WIDTH + after), 7.0)
    write_directional_encoding(at.float(), roughness.float(), rows, before)
    expected = directional_encoding_reference(at, roughness)
    torch.testing.assert_close(rows[:, before : before + CODE_WIDTH].double(), expected, rtol=0, atol=5e-6)
    assert (rows[:, :before] == 7).all()
    assert (rows[:, before + CODE_WIDTH :] == 7).all()


def test_the_same_bits_for_any_number_of_threads():
    at, roughness = directions(5000, 0).float(), torch.rand(5000, generator=torch.Generator().manual_seed(1))
    before = _kernels.threads()
    try:
        results = []
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            rows = torch.zeros(5000, CODE_WIDTH)
            write_directional_encoding(at, roughness, rows, 0)
            results.append(rows)
    finally:
        _kernels.set_threads(before)
    assert all(torch.equal(results[0], other) for other in results[1:])
