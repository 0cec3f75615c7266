"""Steps of cores: in the bases that they are scaled to, what surrounds a core is even."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some

from ringlight.volume.tensor_train import prefixes, suffixes
from ringlight.volume.tt_scaling import Scaling, scalings
from volume.trains import drawn_cores

SAME = {"rtol": 1e-6, "atol": 1e-6}


def even(gram: torch.Tensor) -> torch.Tensor:
    return gram / gram.diagonal().mean()


@given(some.integers(1, 3), some.integers(2, 4), some.integers(2, 12), some.floats(0.1, 0.9), some.integers(0, 99))
@settings(deadline=None, max_examples=25)
def test_grams_of_both_sides_become_even(payload: int, levels: int, most: int, share: float, seed: int):
    cores = drawn_cores(payload, levels, most, seed)
    found = scalings(cores, share)
    for k in range(1, levels):
        before = prefixes(cores[:k]).flatten(0, 1)
        behind = suffixes(cores[k:]).T
        for scaling, rows in ((found[k].left, before), (found[k - 1].right, behind)):
            assert scaling is not None
            eye = torch.eye(len(scaling), dtype=torch.float64)
            mixed = share * even(rows.T @ rows) + (1 - share) * eye
            torch.testing.assert_close(scaling @ mixed @ scaling, eye, **SAME)
            torch.testing.assert_close(scaling, scaling.T, **SAME)
    assert found[0].left is None
    assert found[-1].right is None


def test_a_share_of_nothing_leaves_steps_as_they_are():
    cores = drawn_cores(3, 4, 9)
    for core, scaling in zip(cores, scalings(cores, 0.0), strict=True):
        torch.testing.assert_close(scaling(core), core, **SAME)


def test_a_core_is_multiplied_from_both_sides():
    core, left, right = torch.randn(5, 8, 7), torch.randn(5, 5), torch.randn(7, 7)
    expected = torch.einsum("ab,bic,cd->aid", left, core, right)
    torch.testing.assert_close(Scaling(left, right)(core), expected)
    torch.testing.assert_close(Scaling(None, None)(core), core)


@pytest.mark.parametrize("size", [0.0, 1e-30, 1e30, float("inf"), float("nan")])
@pytest.mark.parametrize("which", [0, 1, 3])
def test_maps_are_finite_whatever_a_core_is(which: int, size: float):
    cores = drawn_cores(2, 4, 9, dtype=torch.float32)
    cores[which] = cores[which] * size
    for scaling in scalings(cores, 0.75):
        for matrix in (scaling.left, scaling.right):
            assert matrix is None or matrix.isfinite().all()
