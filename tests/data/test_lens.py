"""The way of a ray through a lens and back, against COLMAP's own functions."""

import math

import numpy as np
import pytest
from hypothesis import given
from lenses import REAL, cameras, judge, pixel_grid, read

from ringlight.data.lens import Lens


def bent_pixels(model: str, parameters: tuple[float, ...], rays: np.ndarray) -> np.ndarray:
    camera = read(model, parameters)
    return camera.lens.bent(rays) * camera.focal + camera.center


def agrees(model: str, parameters: tuple[float, ...]) -> None:
    theirs, ours = judge(model, parameters), read(model, parameters)
    pixels = pixel_grid(step=16).reshape(-1, 2)
    rays = ours.lens.straightened((pixels - ours.center) / ours.focal)
    assert np.isfinite(rays).all()
    there = np.concatenate([rays, np.ones_like(rays[:, :1])], 1)
    np.testing.assert_allclose(theirs.img_from_cam(there), bent_pixels(model, parameters, rays), atol=1e-6)
    np.testing.assert_allclose(bent_pixels(model, parameters, rays), pixels, atol=1e-5)
    np.testing.assert_allclose(theirs.cam_from_img(pixels), rays, atol=1e-6)


@pytest.mark.parametrize("model", REAL)
def test_a_real_lens_bends_as_in_colmap(model: str):
    agrees(model, REAL[model])


@given(cameras())
def test_any_lens_bends_as_in_colmap(camera: tuple[str, tuple[float, ...]]):
    agrees(*camera)


def test_a_pinhole_bends_nothing():
    points = np.array([[0.0, 0.0], [0.3, -2.0]])
    assert Lens("OPENCV", (0.0, 0.0), (0.0,)).is_straight
    assert (Lens("OPENCV").bent(points) == points).all()
    assert not Lens("FISHEYE", by_angle=True).is_straight


@pytest.mark.parametrize(
    ("lens", "fold"),
    [
        (Lens("SIMPLE_RADIAL", (-0.3,)), 1 / math.sqrt(0.9)),
        (Lens("SIMPLE_RADIAL", (0.3,)), math.inf),
        (Lens("RADIAL_FISHEYE", (-0.1, 0.0), by_angle=True), 1 / math.sqrt(0.3)),
        (Lens("FULL_OPENCV", (), (-0.25,)), 2.0),  # where its divisor is zero
    ],
)
def test_where_a_lens_folds(lens: Lens, fold: float):
    assert lens.fold == pytest.approx(fold)


def test_where_a_lens_shows_nothing_there_is_no_way_back():
    lens = Lens("SIMPLE_RADIAL", (-0.3,))
    last = lens.fold * (1 - 0.3 * lens.fold**2)
    rays = lens.straightened(np.array([[0.0, 0.999 * last], [0.0, 1.001 * last], [0.0, 0.0], [50.0, 0.0]]))
    assert np.isfinite(rays[[0, 2]]).all()
    assert np.isnan(rays[[1, 3]]).all()
    wide = Lens("FISHEYE", by_angle=True).straightened(np.array([[1.5, 0.0], [1.6, 0.0]]))
    assert wide[0, 0] == pytest.approx(math.tan(1.5))
    assert np.isnan(wide[1]).all()  # 92 degrees from the axis: behind a pinhole
