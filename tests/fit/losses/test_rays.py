"""The loss of a lot of rays is a mean in which each counts by its weight, and its gradient is what it says."""

import pytest
import torch

from ringlight.core.rendering import Rendering
from ringlight.data.rays import RayBatch, RayBatches, Rays
from ringlight.fit.losses.rays import RayLoss
from tiny_scene import tiny_scene

COUNT = 50
LOSS = RayLoss(RayBatches(tiny_scene(views=3, size=8), COUNT, 0))


def lot(weights: torch.Tensor | None) -> tuple[torch.Tensor, RayBatch]:
    drawn = torch.Generator().manual_seed(5)
    shown, truth = torch.rand(2, COUNT, 3, generator=drawn)
    zeros = torch.zeros(COUNT, 3)
    return shown, RayBatch(Rays(zeros, zeros, zeros[:, 0]), truth, torch.ones(3), weights)


def rendering(color: torch.Tensor) -> Rendering:
    return Rendering(color, torch.ones(COUNT, 1), {})


@pytest.mark.parametrize("weighted", [False, True])
def test_its_gradient_is_that_of_its_value(weighted: bool):
    weights = 3 * torch.rand(COUNT, generator=torch.Generator().manual_seed(6)) if weighted else None
    shown, batch = lot(weights)
    shown.requires_grad_()
    squares = (shown - batch.colors).square().mean(-1)
    value = (squares if weights is None else squares * weights).mean()
    value.backward()
    compared = LOSS.compare(rendering(shown.detach()), batch, None)
    torch.testing.assert_close(compared.value, value.detach())
    torch.testing.assert_close(compared.grad_color, shown.grad)
    assert compared.weights is weights or torch.equal(compared.weights, weights)


def test_weights_of_one_change_no_bit():
    (shown, even), (_, weighted) = lot(None), lot(torch.ones(COUNT))
    one, other = (LOSS.compare(rendering(shown), batch, None) for batch in (even, weighted))
    assert torch.equal(one.value, other.value)
    assert torch.equal(one.grad_color, other.grad_color)
