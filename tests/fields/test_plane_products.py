"""The kernel of planes times lines against torch in float64, in value and gradient."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ringlight import _kernels
from ringlight.fields.plane_products import (
    PAIRS,
    differentiable_plane_products,
    plane_gradients,
    plane_products,
    plane_products_reference,
)

TOLERANCE = 1e-6
"""Of the largest value or gradient, for each node of the longest axis: where a point falls between two is known so much
less exactly."""

Grids = tuple[list[Tensor], list[Tensor]]


def drawn(count: int, sides: tuple[int, int, int], channels: int, seed: int) -> tuple[Tensor, Grids]:
    """Points, a tenth of them outside, and grids with so many nodes on each axis."""
    generator = torch.Generator().manual_seed(seed)

    def numbers(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator)

    planes = [numbers(sides[second], sides[first], channels) for (first, second), _ in PAIRS]
    lines = [numbers(sides[along], channels) for _, along in PAIRS]
    return torch.rand(count, 3, generator=generator) * 2.2 - 1.1, (planes, lines)


def judged(points: Tensor, grids: Grids, upstream: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Products, and gradients of planes and lines, in float64 by torch's graph."""
    exact = [grid.double().requires_grad_() for part in grids for grid in part]
    products = plane_products_reference(points.double(), exact[:3], exact[3:])
    return products.detach(), list(torch.autograd.grad(products, exact, upstream.double()))


def near(own: Tensor, expected: Tensor, nodes: int) -> None:
    largest = expected.abs().max().item() if expected.numel() else 0.0
    torch.testing.assert_close(own.double(), expected, rtol=0, atol=TOLERANCE * nodes * max(largest, 1))


@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    count=st.integers(0, 70),
    sides=st.tuples(*[st.integers(2, 9)] * 3),
    channels=st.integers(1, 49),
    seed=st.integers(0, 10_000),
)
def test_kernel_equals_torch(count, sides, channels, seed):
    points, grids = drawn(count, sides, channels, seed)
    generator = torch.Generator().manual_seed(seed)
    upstream = torch.randn(count, 3 * channels, generator=generator)
    expected, expected_gradients = judged(points, grids, upstream)
    near(plane_products(points, *grids), expected, max(sides))
    of_planes, of_lines = plane_gradients(points, *grids, upstream)
    for own, exact in zip((*of_planes, *of_lines), expected_gradients, strict=True):
        near(own, exact, max(sides))


def test_kernel_equals_torch_at_the_size_of_3igs():
    points, grids = drawn(2000, (150, 150, 150), 48, 0)
    upstream = torch.randn(2000, 144, generator=torch.Generator().manual_seed(1))
    expected, expected_gradients = judged(points, grids, upstream)
    near(plane_products(points, *grids), expected, 150)
    of_planes, of_lines = plane_gradients(points, *grids, upstream)
    for own, exact in zip((*of_planes, *of_lines), expected_gradients, strict=True):
        near(own, exact, 150)


def test_nodes_are_where_the_glossary_says():
    """Row for a pair's second axis, column for its first: each product is that of two nodes at a corner."""
    _, (planes, lines) = drawn(0, (3, 4, 5), 2, 0)
    found = plane_products(torch.tensor([[-1.0, 1.0, 0.0]]), planes, lines).view(3, 2)
    nodes = {0: 0, 1: 3, 2: 2}
    for (first, second), along in PAIRS:
        pair = PAIRS.index(((first, second), along))
        expected = planes[pair][nodes[second], nodes[first]] * lines[pair][nodes[along]]
        torch.testing.assert_close(found[pair], expected)


def test_what_is_no_number_lies_at_the_first_node():
    _, grids = drawn(0, (3, 4, 5), 3, 0)
    at = torch.tensor([[torch.nan, torch.inf, -torch.inf]])
    assert torch.equal(plane_products(at, *grids), plane_products(torch.tensor([[-1.0, 1.0, -1.0]]), *grids))


def test_nodes_that_no_point_is_near_get_zeros():
    points, grids = drawn(5, (6, 6, 6), 20, 0)
    points = points.clamp(-1, -0.9)
    into = [torch.full_like(grid, torch.nan) for grid in grids[0]], [torch.full_like(grid, 7.0) for grid in grids[1]]
    of_planes, of_lines = plane_gradients(points, *grids, torch.ones(5, 60), into)
    assert of_planes is into[0]
    assert all(
        torch.count_nonzero(plane[2:]) == 0 and plane[:2].abs().min() > 0 for plane in (p[:, :2] for p in of_planes)
    )
    assert all(torch.count_nonzero(line[2:]) == 0 for line in of_lines)


@pytest.mark.parametrize("channels", [16, 40])
def test_the_same_bits_for_any_number_of_threads(channels: int):
    points, grids = drawn(5000, (20, 25, 30), channels, 0)
    upstream = torch.randn(5000, 3 * channels, generator=torch.Generator().manual_seed(1))
    before = _kernels.threads()
    try:
        results = []
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            of_planes, of_lines = plane_gradients(points, *grids, upstream)
            results.append((plane_products(points, *grids), *of_planes, *of_lines))
    finally:
        _kernels.set_threads(before)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_other_types_go_through_torch():
    points, grids = drawn(30, (5, 6, 7), 4, 0)
    points, exact = points.double(), ([p.double() for p in grids[0]], [line.double() for line in grids[1]])
    upstream = torch.randn(30, 12, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    expected, expected_gradients = judged(points, exact, upstream)
    assert torch.equal(plane_products(points, *exact), expected)
    of_planes, of_lines = plane_gradients(points, *exact, upstream)
    assert all(map(torch.equal, (*of_planes, *of_lines), expected_gradients))


def test_torchs_graph_goes_on_through_the_kernel():
    points, (planes, lines) = drawn(50, (5, 6, 7), 8, 0)
    grids = [grid.requires_grad_() for grid in (*planes, *lines)]
    products = differentiable_plane_products(points, planes, lines)
    found = torch.autograd.grad(products.sin().sum(), grids)
    by_torch = plane_products_reference(points, planes, lines)
    expected = torch.autograd.grad(by_torch.sin().sum(), grids)
    for own, exact in zip(found, expected, strict=True):
        torch.testing.assert_close(own, exact, rtol=1e-4, atol=1e-4)


def test_grids_that_do_not_fit_are_refused():
    points, (planes, lines) = drawn(5, (5, 6, 7), 8, 0)
    with pytest.raises(ValueError, match="same channels"):
        plane_products(points, planes, [lines[0][:, :4], *lines[1:]])
    with pytest.raises(ValueError, match="2 to 4096 nodes"):
        plane_products(points, [planes[0][:1], *planes[1:]], lines)
    with pytest.raises(ValueError, match="gradients must have their grids' sizes"):
        plane_gradients(points, planes, lines, torch.ones(5, 24), (planes[::-1], lines[::-1]))
