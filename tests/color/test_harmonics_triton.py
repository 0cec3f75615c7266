"""The harmonics' Triton kernels against the reference, in value and gradient."""

import pytest
import torch

import interpreted
from ringlight.color.harmonics import sh_colors_reference
from ringlight.color.harmonics_triton import sh_colors_by_triton


@pytest.mark.parametrize(("degree", "stored"), [(0, 0), (0, 15), (1, 3), (1, 15), (2, 8), (3, 15)])
@pytest.mark.parametrize("count", [1, 300])
def test_equals_the_reference(degree: int, stored: int, count: int):
    generator = torch.Generator().manual_seed(degree)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    inputs, position, upstream = [draw(count, 3), draw(count, 3), draw(count, stored, 3)], draw(3), draw(count, 3)

    exact = [tensor.double().requires_grad_() for tensor in inputs]
    expected = sh_colors_reference(*exact, position.double(), degree)
    expected.backward(upstream.double())
    ours = [tensor.to(interpreted.DEVICE).requires_grad_() for tensor in inputs]
    found = sh_colors_by_triton(*ours, position, degree)
    found.backward(upstream.to(interpreted.DEVICE))
    assert count == 1 or (expected == 0).any(), "some are clamped"
    for mine, truth in [(found, expected), *((a.grad, b.grad) for a, b in zip(ours, exact, strict=True))]:
        truth = torch.zeros_like(mine, device="cpu").double() if truth is None else truth
        scale = truth.abs().max().item() if truth.numel() else 0.0
        torch.testing.assert_close(mine.cpu().double(), truth, rtol=0, atol=2e-5 * scale + 1e-9)


def test_rows_without_the_degrees_harmonics_are_refused():
    means, rest = torch.zeros(4, 3), torch.zeros(4, 3, 3)
    with pytest.raises(ValueError, match="rest holds 3 harmonics, and degree 2 has 8"):
        sh_colors_by_triton(means, means, rest, torch.ones(3), 2)
