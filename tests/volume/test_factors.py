"""Factors are grids of products, linear in between; refining them changes nothing that is shown, cropping no node."""

import pytest
import torch

from ringlight.volume.factors import Factors

SIDES = (7, 9, 6)


def factors(kind, components: int = 4) -> Factors:
    return Factors(kind, SIDES, components, torch.Generator().manual_seed(2))


def nodes(sides=SIDES) -> torch.Tensor:
    axes = [torch.linspace(0, 1, side) for side in sides]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).view(-1, 3)


@pytest.mark.parametrize("kind", ["vm", "cp"])
def test_at_nodes_components_are_products_of_stored_numbers(kind):
    made = factors(kind)
    found = made(nodes()).view(*SIDES, -1)
    if kind == "cp":
        x, y, z = made.lines
        expected = torch.einsum("xm,ym,zm->xyzm", x, y, z)
    else:
        (xy, xz, yz), (z, y, x) = made.planes, made.lines
        parts = ("yxm,zm->xyzm", xy, z), ("zxm,ym->xyzm", xz, y), ("zym,xm->xyzm", yz, x)
        expected = torch.cat([torch.einsum(*part) for part in parts], -1)
    assert found.shape[-1] == made.width
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", ["vm", "cp"])
def test_twice_as_fine_a_grid_shows_the_same(kind):
    made, places = factors(kind), torch.rand(500, 3, generator=torch.Generator().manual_seed(4))
    before = made(places)
    made.resize(tuple(2 * side - 1 for side in SIDES))
    assert made.sides == (13, 17, 11)
    torch.testing.assert_close(made(places), before, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", ["vm", "cp"])
def test_cropped_to_some_nodes_it_keeps_them(kind):
    made = factors(kind)
    whole = made(nodes()).view(*SIDES, -1)
    made.crop((1, 2, 0), (4, 8, 3))
    assert made.sides == (4, 7, 4)
    torch.testing.assert_close(made(nodes(made.sides)).view(4, 7, 4, -1), whole[1:5, 2:9, 0:4], rtol=1e-4, atol=1e-6)
