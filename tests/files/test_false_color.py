"""Buffers become pictures in [0, 1] whose gray or colour can be read back."""

import pytest
import torch

from ringlight.files.false_color import (
    FARTHEST_GRAY,
    depth_picture,
    depth_range,
    gray_picture,
    nearest_depth,
    signed_picture,
)


def test_near_is_white_far_is_dark_and_nothing_is_black() -> None:
    distance = torch.linspace(2.0, 6.0, 50)[None, :, None]
    alpha = torch.ones_like(distance)
    alpha[:, 40:] = 0
    picture = depth_picture(distance, alpha, near_far=(2.0, 6.0))
    assert picture.shape == (1, 50, 3)
    assert picture[0, 0, 0] == 1
    assert (picture[0, :39, 0] > picture[0, 1:40, 0]).all()
    assert picture[0, 39, 0] > FARTHEST_GRAY
    assert (picture[0, 40:] == 0).all()


def test_floaters_and_thin_pixels_do_not_set_the_scale() -> None:
    distance = torch.linspace(2.0, 6.0, 1000)[None, :, None].clone()
    alpha = torch.ones_like(distance)
    distance[0, 5], distance[0, 7], alpha[0, 9], distance[0, 9] = 1e6, float("nan"), 0.1, 1e-6
    near, far = depth_range(distance, alpha)
    assert near == pytest.approx(2.08, abs=0.02)
    assert far == pytest.approx(5.92, abs=0.03)


def test_an_empty_picture_is_black() -> None:
    empty = torch.zeros(4, 5, 1)
    assert depth_range(empty, empty) == (0.0, 1.0)
    assert (depth_picture(empty, empty, (0.0, 1.0)) == 0).all()


def test_a_picture_larger_than_a_quantile_may_be() -> None:
    distance = torch.linspace(1.0, 2.0, 17_000_000)[None, :, None]
    near, far = depth_range(distance, torch.ones_like(distance))
    assert (near, far) == pytest.approx((1.02, 1.98), abs=1e-3)


def test_signed_values_sit_around_middle_gray() -> None:
    values = torch.tensor([[[-1.0, 0.0, 1.0]]])
    assert signed_picture(values / 4).tolist() == [[[0.375, 0.5, 0.625]]]
    assert signed_picture(5 * values).tolist() == [[[0.0, 0.5, 1.0]]]
    assert gray_picture(torch.tensor([[[0.25]]])).tolist() == [[[0.25, 0.25, 0.25]]]


def test_the_nearest_surface_of_a_faint_picture_is_found() -> None:
    depth, alpha = torch.full((10, 10, 1), 5.0), torch.full((10, 10, 1), 0.1)
    depth[0], alpha[0] = 0.5, 0.01
    depth[1], alpha[1] = 3.0, 0.08
    assert nearest_depth(depth, alpha) == pytest.approx(3.0)
    assert nearest_depth(torch.zeros(4, 4, 1), torch.zeros(4, 4, 1)) == float("inf")
