import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.directions import normalize, octahedral_from_directions
from ringlight.fields.tables import (
    MOST_SHARED,
    axis_nodes,
    between_map_nodes,
    between_nodes,
    octahedral_nodes,
    shares_of_nodes,
)


@settings(max_examples=20)
@given(count=st.integers(2, 40), seed=st.integers(0, 1000))
def test_linear_functions_are_reproduced(count, seed):
    generator = torch.Generator().manual_seed(seed)
    table = axis_nodes(count)[:, None].double() * torch.tensor([[2.0, -1.0]]).double() + 0.5
    at = torch.rand(50, generator=generator).double() * 2 - 1
    expected = at[:, None] * torch.tensor([[2.0, -1.0]]).double() + 0.5
    torch.testing.assert_close(between_nodes(table, at), expected, rtol=0, atol=1e-6)


def test_nodes_and_outside():
    table = torch.randn(9, 3)
    torch.testing.assert_close(between_nodes(table, axis_nodes(9)), table, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(between_nodes(table, torch.tensor([-4.0, 7.0])), table[[0, -1]])


@settings(max_examples=20)
@given(count=st.integers(2, 40), seed=st.integers(0, 1000))
def test_a_product_of_matrices_reads_the_same(count, seed):
    """What a GPU does, in values and gradients: at nodes, between them, outside, and where there is no number."""
    generator = torch.Generator().manual_seed(seed)
    table = torch.randn(count, 3, generator=generator, dtype=torch.float64).requires_grad_()
    between = torch.rand(50, generator=generator, dtype=torch.float64) * 3 - 1.5
    at = torch.cat([between, axis_nodes(count).double(), torch.tensor([torch.nan])]).requires_grad_()
    upstream = torch.randn(len(at), 3, generator=generator, dtype=torch.float64)
    read, product = between_nodes(table, at), shares_of_nodes(at, count) @ table
    torch.testing.assert_close(product, read)
    by_reading = torch.autograd.grad(read, [table, at], upstream)
    torch.testing.assert_close(torch.autograd.grad(product, [table, at], upstream), by_reading)


@pytest.mark.cuda
@pytest.mark.parametrize("count", [16, MOST_SHARED, MOST_SHARED + 1])
def test_a_gpu_reads_the_same(count: int):
    generator = torch.Generator().manual_seed(count)
    along, over = torch.randn(count, 5, generator=generator), torch.randn(count**2, 5, generator=generator)
    uv, upstream = torch.rand(3000, 2, generator=generator) * 2 - 1, torch.randn(3000, 5, generator=generator)

    def read(device: str) -> list[torch.Tensor]:
        line, square, at = (tensor.to(device).requires_grad_() for tensor in (along, over, uv))
        values = between_nodes(line, at[:, 0]) * between_map_nodes(square, at)
        return [values, *torch.autograd.grad(values, [line, square, at], upstream.to(device))]

    for there, here in zip(read("cuda"), read("cpu"), strict=True):
        torch.testing.assert_close(there.cpu(), here, rtol=1e-4, atol=1e-3)


def test_nan_is_the_first_node():
    table = torch.randn(9, 3)
    assert torch.equal(between_nodes(table, torch.tensor([torch.nan])), table[:1])


def test_octahedral_nodes_are_where_they_are_looked_up():
    table = torch.randn(25, 2)
    inside = [row * 5 + column for row in range(5) for column in range(5) if 0 < row < 4 and 0 < column < 4]
    uv = octahedral_from_directions(octahedral_nodes(5)[inside])
    torch.testing.assert_close(between_map_nodes(table, uv), table[inside], rtol=1e-4, atol=1e-4)


def test_map_is_continuous_over_the_seams():
    nodes = octahedral_nodes(16).double()
    table = (nodes @ torch.randn(3, 4, dtype=torch.float64)).tanh()
    angle = torch.linspace(0, 6.28, 200, dtype=torch.float64)
    seam = torch.stack([angle.cos(), torch.full_like(angle, -1e-9), -angle.sin().abs() - 0.01], -1)
    other = seam * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)
    here, there = (between_map_nodes(table, octahedral_from_directions(normalize(side))) for side in (seam, other))
    torch.testing.assert_close(here, there, rtol=0, atol=1e-6)


@pytest.mark.parametrize("side", [2, 3, 16])
def test_octahedral_nodes_are_unit(side):
    torch.testing.assert_close(octahedral_nodes(side).norm(dim=1), torch.ones(side * side))
