"""The kernel of the heads against torch in float64, in value and gradient.

Where it multiplies in bfloat16, tolerances are wider, and large biases keep hidden units from their kinks;
tests/test_isa.py runs the same code on floats.
"""

import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor

from ringlight import _kernels
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_at, stack_gradients

# Hidden units nearer to zero than this may be on the other side of the ReLU in single precision.
KINK = 2e-6
BF16 = _kernels.isa() in ("avx512_bf16", "avx512_amx")
TOLERANCE, SMALLEST = (0.02, 0.02) if BF16 else (1e-5, 1e-6)
"""Of the largest value or gradient, and absolute: bfloat16 has eight bits, and sums cancel."""
FAR_BIAS = 4.0
"""Times the inputs' width more than a hidden unit's inputs add up to, and four times as much in the next layer."""


def stack_and_rows(heads: int, widths: tuple[int, ...], nodes: int, seed: int) -> tuple[PerceptronStack, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    stack = PerceptronStack(heads, widths, generator)
    with torch.no_grad():
        for depth, bias in enumerate(stack.biases[:-1] if BF16 else ()):
            signs = torch.where(torch.arange(bias.shape[-1]) % 2 == 0, 1.0, -1.0)
            bias.copy_(FAR_BIAS * widths[0] ** 0.5 * 4**depth * signs)
    return stack, torch.randn(heads, nodes, widths[0], generator=generator)


def gradients(stack: PerceptronStack, rows: Tensor, upstream: Tensor) -> tuple[Tensor, list[Tensor]]:
    found = stack_gradients(stack, rows, upstream)
    return stack_at(stack, rows), [found[name] for name, _ in stack.named_parameters()]


def nearest_kink(stack: PerceptronStack, rows: Tensor) -> float:
    first = torch.baddbmm(stack.biases[0], rows, stack.weights[0])
    second = torch.baddbmm(stack.biases[1], first.relu(), stack.weights[1])
    return min(first.abs().min().item(), second.abs().min().item())


def compare(heads: int, widths: tuple[int, ...], nodes: int, seed: int) -> None:
    stack, rows = stack_and_rows(heads, widths, nodes, seed)
    upstream = torch.randn(heads, nodes, widths[-1], generator=torch.Generator().manual_seed(seed))
    fast, fast_gradients = gradients(stack, rows, upstream)
    slow = stack.double()(rows.double())
    slow_gradients = torch.autograd.grad(slow, list(stack.parameters()), upstream.double())
    torch.testing.assert_close(fast.double(), slow, rtol=0, atol=TOLERANCE * max(slow.abs().max().item(), 1))
    for own, expected in zip(fast_gradients, slow_gradients, strict=True):
        assert (own - expected).abs().max() <= TOLERANCE * expected.abs().max() + SMALLEST


@settings(max_examples=25, derandomize=True)
@given(
    heads=st.integers(1, 3),
    inputs=st.integers(1, 40),
    hidden=st.integers(1, 30),
    outputs=st.integers(1, 40),
    nodes=st.integers(1, 70),
    seed=st.integers(0, 10_000),
)
def test_kernel_equals_torch(heads, inputs, hidden, outputs, nodes, seed):
    widths = (inputs, hidden, hidden, outputs)
    stack, rows = stack_and_rows(heads, widths, nodes, seed)
    assume(nearest_kink(stack.double(), rows.double()) > KINK)
    compare(heads, widths, nodes, seed)


def test_kernel_equals_torch_at_the_papers_size():
    """Two shards, the second one incomplete."""
    widths, nodes = (21, 128, 128, 256), 300
    seeds = (s for s in range(50) if _is_smooth(widths, nodes, s))
    compare(3, widths, nodes, next(seeds))


def _is_smooth(widths: tuple[int, ...], nodes: int, seed: int) -> bool:
    stack, rows = stack_and_rows(3, widths, nodes, seed)
    return nearest_kink(stack.double(), rows.double()) > KINK


def test_the_same_bits_for_any_number_of_threads():
    stack, rows = stack_and_rows(3, (9, 20, 20, 12), 600, 0)
    upstream = torch.randn(3, 600, 12, generator=torch.Generator().manual_seed(1))
    before = _kernels.threads()
    try:
        results = []
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            results.append(gradients(stack, rows, upstream))
    finally:
        _kernels.set_threads(before)
    for value, parameters in results[1:]:
        assert torch.equal(value, results[0][0])
        assert all(torch.equal(a, b) for a, b in zip(parameters, results[0][1], strict=True))


def test_other_depths_and_types_go_through_torch():
    stack, rows = stack_and_rows(2, (4, 5, 3), 7, 0)
    upstream = torch.randn(2, 7, 3, generator=torch.Generator().manual_seed(1))
    for other, at in ((stack, rows), (stack_and_rows(2, (4, 5, 5, 3), 7, 0)[0].double(), rows.double())):
        expected = other(at)
        assert torch.equal(stack_at(other, at), expected)
        found = stack_gradients(other, at, upstream.to(at))
        by_graph = torch.autograd.grad(expected, list(other.parameters()), upstream.to(at))
        for (name, _), gradient in zip(other.named_parameters(), by_graph, strict=True):
            assert torch.equal(found[name], gradient), name


def test_rows_get_their_gradient_where_it_is_wanted():
    stack, rows = stack_and_rows(2, (21, 24, 24, 3), 70, 0)
    upstream, of_rows = torch.randn(2, 70, 3, generator=torch.Generator().manual_seed(1)), torch.empty_like(rows)
    stack_gradients(stack, rows, upstream, of_rows)
    at = rows.double().requires_grad_()
    (expected,) = torch.autograd.grad(stack.double()(at), at, upstream.double())
    assert (of_rows - expected).abs().max() <= TOLERANCE * expected.abs().max() + SMALLEST
