"""The perceptron's Triton kernels against the reference, in value and gradient."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import interpreted
from ringlight.fields import perceptron_triton
from ringlight.fields.networks import perceptron
from ringlight.fields.perceptron_triton import perceptron_by_triton


@settings(max_examples=8, derandomize=True)
@given(
    count=st.integers(1, 90),
    inputs=st.integers(1, 40),
    hidden=st.integers(1, 40),
    outputs=st.integers(1, 20),
    deep=st.booleans(),
)
def test_equals_the_reference(count: int, inputs: int, hidden: int, outputs: int, deep: bool):
    check((inputs, *[hidden] * (1 + deep), outputs), count, 2e-5)


@pytest.mark.skipif(not interpreted.HAS_GPU, reason="Triton's interpreter multiplies the bits of bfloat16 numbers")
@pytest.mark.parametrize("deep", [False, True])
def test_products_of_bfloat16_are_near(deep: bool):
    check((35, *[64] * (1 + deep), 3), 50, 2e-2, half=True, gradients=0.1)  # units near zero are on here, off there


def test_few_programs_take_many_rows(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(perceptron_triton, "MOST_PROGRAMS", 1)
    check((7, 9, 9, 3), 2 * perceptron_triton.ROWS + 5, 2e-5)


def test_no_rows():
    network = perceptron((4, 8, 2), torch.Generator().manual_seed(0)).to(interpreted.DEVICE)
    parameters = list(network.parameters())
    nothing = perceptron_by_triton(torch.zeros(0, 4, device=interpreted.DEVICE), parameters)
    nothing.sum().backward()
    assert nothing.shape == (0, 2)
    assert all((parameter.grad == 0).all() for parameter in parameters)


def check(widths: tuple[int, ...], count: int, tolerance: float, half: bool = False, gradients: float | None = None):
    generator = torch.Generator().manual_seed(count)
    exact = perceptron(widths, generator).double()
    rows = torch.randn(count, widths[0], generator=generator)
    upstream = torch.randn(count, widths[-1], generator=generator)
    truth = rows.double().requires_grad_()
    expected = exact(truth)
    expected.backward(upstream.double())
    ours = rows.to(interpreted.DEVICE).requires_grad_()
    layers = [p.detach().float().to(interpreted.DEVICE).requires_grad_() for p in exact.parameters()]
    found = perceptron_by_triton(ours, layers, half)
    found.backward(upstream.to(interpreted.DEVICE))
    pairs = [(found, expected), (ours.grad, truth.grad)]
    pairs += [(mine.grad, layer.grad) for mine, layer in zip(layers, exact.parameters(), strict=True)]
    differences = [(mine.detach().cpu().double() - right, right) for mine, right in pairs]
    errors = [(difference.norm() / right.norm().clamp_min(1e-9)).item() for difference, right in differences]
    assert errors[0] < tolerance
    assert max(errors) < (gradients or tolerance)
