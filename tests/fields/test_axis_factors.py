"""Factors of a point are products of what its axes hold."""

import torch

from ringlight.fields.axis_factors import AxisFactors


def test_all_are_one_at_the_start():
    assert torch.equal(AxisFactors(5, 3)(torch.randn(7, 3)), torch.ones(7, 3))


def test_linear_axes_give_products_of_coordinates_held_beyond_the_ends():
    factors = AxisFactors(9, 2)
    with torch.no_grad():
        factors.axes.copy_(torch.linspace(-1, 1, 9)[None, :, None].expand(3, 9, 2))
    points = torch.tensor([[0.3, -0.6, 0.9], [2.0, 0.5, -7.0]])
    expected = points.clamp(-1, 1).prod(-1, keepdim=True).expand(2, 2)
    torch.testing.assert_close(factors(points), expected)


def test_a_point_that_is_no_number_raises_nothing():
    assert AxisFactors(5, 3)(torch.full((1, 3), torch.nan)).isfinite().all()
