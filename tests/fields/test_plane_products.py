"""Planes times lines: where nodes lie, and what becomes of points that are nowhere."""

import torch
from torch import Tensor

from ringlight.fields.plane_products import PAIRS, plane_products


def grids(sides: tuple[int, int, int], channels: int) -> tuple[list[Tensor], list[Tensor]]:
    """Planes and lines with so many nodes on each axis."""
    generator = torch.Generator().manual_seed(0)

    def numbers(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator)

    planes = [numbers(sides[second], sides[first], channels) for (first, second), _ in PAIRS]
    return planes, [numbers(sides[along], channels) for _, along in PAIRS]


def test_nodes_are_where_the_glossary_says():
    """Row for a pair's second axis, column for its first: each product is that of two nodes at a corner."""
    planes, lines = grids((3, 4, 5), 2)
    found = plane_products(torch.tensor([[-1.0, 1.0, 0.0]]), planes, lines).view(3, 2)
    nodes = {0: 0, 1: 3, 2: 2}
    for (first, second), along in PAIRS:
        pair = PAIRS.index(((first, second), along))
        expected = planes[pair][nodes[second], nodes[first]] * lines[pair][nodes[along]]
        torch.testing.assert_close(found[pair], expected)


def test_half_way_is_the_mean_of_eight_products():
    planes, lines = grids((2, 2, 2), 3)
    found = plane_products(torch.zeros(1, 3), planes, lines).view(3, 3)
    for pair in range(len(PAIRS)):
        torch.testing.assert_close(found[pair], planes[pair].mean((0, 1)) * lines[pair].mean(0))


def test_what_is_no_number_lies_at_the_first_node():
    planes, lines = grids((3, 4, 5), 3)
    at = torch.tensor([[torch.nan, torch.inf, -torch.inf]])
    corner = torch.tensor([[-1.0, 1.0, -1.0]])
    assert torch.equal(plane_products(at, planes, lines), plane_products(corner, planes, lines))
