"""Importance sampling: the right gradient in expectation, from fewer rows, and the same draw for the same bits."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.importance_sampling import importance_sampled, importance_weights


def heavy_tailed(count: int, seed: int) -> torch.Tensor:
    """Gradients of which a few are large, as those of Gaussians are."""
    noise = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed))
    return noise * noise[:, :1].exp()


@settings(max_examples=30, derandomize=True)
@given(count=st.integers(1, 400), seed=st.integers(0, 1000), share=st.floats(0.05, 0.95))
def test_what_is_drawn_counts_for_all(count, seed, share):
    """Weights average to one over many lots, that is over gradients whose last bits differ."""
    gradient = heavy_tailed(count, seed)
    lots = [importance_weights(gradient * (1 + 1e-5 * k), share) for k in range(300)]
    mean = torch.stack(lots).mean(0)
    sizes = gradient.abs().sum(-1)
    error = ((mean - 1) * sizes).sum().abs() / sizes.sum()
    assert error < 0.2 / (share * count) ** 0.5, "five deviations of such a mean at most"
    drawn = torch.stack([(weights > 0).float().mean() for weights in lots]).mean()
    assert drawn <= share + 0.25 / count**0.5


def test_neighbours_are_drawn_evenly():
    """Equal chances of a quarter: every fourth row, from any start."""
    drawn = importance_weights(torch.full((64, 3), 0.3), 0.25) > 0
    assert drawn.nonzero().flatten().diff().tolist() == [4] * 15


def test_large_gradients_are_certain_and_weigh_one():
    gradient = torch.full((100, 3), 0.05)
    gradient[7] = 5.0
    weights = importance_weights(gradient, 0.3)
    assert weights[7] == 1
    assert 1 < (weights > 0).sum() < 60
    assert weights.max() > 1


def test_rows_without_gradient_are_never_drawn_and_do_not_count():
    gradient = heavy_tailed(200, 3)
    gradient[::2] = 0
    weights = importance_weights(gradient, 0.5)
    assert not weights[::2].any()
    assert torch.equal(weights[1::2], importance_weights(gradient[1::2], 0.5))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_gradient_that_is_no_number_is_not_hidden(bad):
    gradient = heavy_tailed(50, 3)
    gradient[20, 1] = bad
    assert torch.equal(importance_weights(gradient, 0.2), torch.ones(50))


def test_values_pass_and_gradients_are_weighted():
    values = torch.randn(80, 3, requires_grad=True)
    upstream = heavy_tailed(80, 1)
    drawn = importance_sampled(values, 0.4)
    assert torch.equal(drawn, values)
    drawn.backward(upstream)
    assert torch.equal(values.grad, upstream * importance_weights(upstream, 0.4)[:, None])
    assert importance_sampled(values, 1.0) is values
