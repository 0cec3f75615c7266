"""Steps along near-orthogonal matrices: what a mean gradient tells counts about alike, on either side of a core."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some

from ringlight.volume.tt_directions import (
    STEP_SIZE,
    inverse_roots,
    near_inverse_root,
    near_orthogonal_reference,
)

SAME = {"rtol": 1e-9, "atol": 1e-9}
SIDES = some.integers(1, 24)


def drawn(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def with_singular_values(values: torch.Tensor, columns: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    left, _ = torch.linalg.qr(drawn(len(values), len(values), seed=1))
    right, _ = torch.linalg.qr(drawn(columns, len(values), seed=2))
    return (left * values) @ right.T, left, right


def near_orthogonal(matrix: torch.Tensor) -> torch.Tensor:
    """Of its own root; its norm is taken out, as Muon has it."""
    root = near_inverse_root(matrix)
    scaled = matrix / matrix.norm()
    return scaled @ root if len(matrix) > matrix.shape[1] else root @ scaled


def own_direction(mean: torch.Tensor) -> torch.Tensor:
    return inverse_roots(mean)(mean)


@given(SIDES, SIDES, some.integers(0, 99))
@settings(deadline=None, max_examples=40)
def test_gram_matrices_give_what_whole_matrices_do(rows: int, columns: int, seed: int):
    matrix = drawn(rows, columns, seed=seed)
    torch.testing.assert_close(near_orthogonal(matrix), near_orthogonal_reference(matrix), **SAME)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_singular_values_come_near_one_and_vectors_stay(dtype: torch.dtype):
    values = torch.logspace(0, -5, 60, dtype=torch.float64)
    matrix, left, right = with_singular_values(values, 200)
    found = left.T @ near_orthogonal(matrix.to(dtype)).double() @ right
    shares = values / values.norm()
    near = found.diagonal()[shares > 1e-3]
    assert 0.4 < near.min() < near.max() < 1.3
    assert (found.diagonal() > 0).all()
    assert (found - found.diagonal().diag()).abs().max() < 1e-3


@given(SIDES, some.integers(1, 8), SIDES, some.integers(0, 99))
@settings(deadline=None, max_examples=40)
def test_a_direction_has_one_size_and_goes_with_its_mean(left: int, middle: int, right: int, seed: int):
    mean = drawn(left, middle, right, seed=seed)
    found = own_direction(mean)
    assert found.square().mean().sqrt().item() == pytest.approx(STEP_SIZE)
    assert (found * mean).sum() > 0
    torch.testing.assert_close(own_direction(1e-5 * mean), found, **SAME)


@given(SIDES, some.integers(1, 8), SIDES, some.integers(0, 99))
@settings(deadline=None, max_examples=40)
def test_roots_of_another_mean_multiply_both_matrices_of_this_one(left: int, middle: int, right: int, seed: int):
    mean, other = drawn(left, middle, right, seed=seed), drawn(left, middle, right, seed=seed + 100)
    roots = inverse_roots(other)
    sides = []
    for matrix, of_other in ((mean.flatten(1), other.flatten(1)), (mean.flatten(0, 1), other.flatten(0, 1))):
        # The root is a function of the other mean's Gram matrix: it scales that one's singular vectors alone.
        short = of_other if len(of_other) <= of_other.shape[1] else of_other.T
        vectors, values, _ = torch.linalg.svd(short, full_matrices=False)
        scales = torch.ones_like(values)
        for _ in range(5):
            now = values / short.norm() * scales
            scales = scales * (3.4445 - 4.7750 * now**2 + 2.0315 * now**4)
        root = (vectors * scales) @ vectors.T
        found = matrix @ root if len(of_other) > of_other.shape[1] else root @ matrix
        sides.append((found / found.square().mean().sqrt()).view_as(mean))
    expected = sum(sides)
    expected = STEP_SIZE * expected / expected.square().mean().sqrt()
    torch.testing.assert_close(roots(mean), expected, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(roots(1e-5 * mean), roots(mean), **SAME)


def test_roots_of_no_mean_leave_a_direction_as_it_is():
    mean = drawn(4, 8, 6)
    found = inverse_roots(torch.zeros_like(mean))(mean)
    torch.testing.assert_close(found, STEP_SIZE * mean / mean.square().mean().sqrt(), **SAME)


def test_left_and_right_index_count_alike():
    mean = drawn(6, 8, 9)
    turned = own_direction(mean.permute(2, 1, 0)).permute(2, 1, 0)
    torch.testing.assert_close(own_direction(mean), turned, **SAME)
    bases = [torch.linalg.qr(drawn(side, side, seed=side))[0] for side in (6, 9)]
    rotated = torch.einsum("ab,bic,cd->aid", bases[0], mean, bases[1])
    expected = torch.einsum("ab,bic,cd->aid", bases[0], own_direction(mean), bases[1])
    torch.testing.assert_close(own_direction(rotated), expected, **SAME)


@pytest.mark.parametrize("size", [0.0, 1e-38, 1e30])
def test_a_direction_is_finite_whatever_the_size_of_its_mean(size: float):
    mean = drawn(5, 8, 7, dtype=torch.float32)
    found = own_direction(size * mean)
    expected = own_direction(mean) if size else torch.zeros_like(mean)
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-3)
