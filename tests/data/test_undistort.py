"""Pictures without distortion: the camera and the pixels of COLMAP's image_undistorter."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from lenses import HEIGHT, REAL, WIDTH, cameras, judge, pixel_grid, read, undistorted

from ringlight.data.undistort import NEGLIGIBLE, Undistortion, farthest_moved, undistortion_of
from ringlight.errors import SceneError

AGREED = 0.1
"""Pixels that a place may differ from COLMAP's."""

PERIOD = 0.26
"""Of the pattern's waves, as the sine of an angle: 40 to 80 pixels."""

BLOCK = 24
"""Pixels a side, within which a displacement is measured."""


def made_of(model: str, parameters: tuple[float, ...]) -> Undistortion:
    made = undistortion_of(read(model, parameters), "camera 1")
    assert made is not None
    return made


def pattern(rays: np.ndarray) -> np.ndarray:
    """Waves, of different ones in each channel: what rays see."""
    sines = rays / np.sqrt(1 + np.square(rays).sum(-1, keepdims=True))
    x, y = 2 * math.pi * sines[..., 0] / PERIOD, 2 * math.pi * sines[..., 1] / PERIOD
    waves = np.stack([np.sin(x) * np.cos(y), np.sin(0.7 * x + 1), np.sin(0.5 * x + 0.8 * y)], -1)
    return np.rint(127.5 + 120 * waves).astype(np.uint8)


def photograph_of(model: str, parameters: tuple[float, ...]) -> np.ndarray:
    """The pattern as the judge's lens shows it."""
    rays = judge(model, parameters).cam_from_img(pixel_grid().reshape(-1, 2))
    return pattern(rays.reshape(HEIGHT, WIDTH, 2))


def displacements(picture: np.ndarray, other: np.ndarray) -> np.ndarray:
    """By how many pixels (x, y) the two differ in each block, by least squares on the slopes; [N 2]."""
    slopes = np.stack(np.gradient(picture, axis=(1, 0)), -1)
    blocks = [(y, x) for y in range(0, len(picture) - BLOCK, BLOCK) for x in range(0, picture.shape[1] - BLOCK, BLOCK)]
    moved = []
    for y, x in blocks:
        here = np.s_[y : y + BLOCK, x : x + BLOCK]
        moved.append(np.linalg.lstsq(slopes[here].reshape(-1, 2), (other - picture)[here].ravel(), rcond=None)[0])
    return np.array(moved)


def test_displacements_are_measured():
    here, there = (pattern((pixel_grid() - center) / 200).astype(float) for center in ([160, 120], [159.7, 120.2]))
    moved = displacements(here, there)
    np.testing.assert_allclose(moved, np.broadcast_to([0.3, -0.2], moved.shape), atol=0.05)


def agrees(model: str, parameters: tuple[float, ...]) -> None:
    theirs, lens = judge(model, parameters), made_of(model, parameters)
    chosen = undistorted(theirs)
    ours = lens.pinhole
    # Where a side is a whole number of pixels but for the last bits, rounding down may differ by one.
    assert abs(ours.width - chosen.width) <= 1
    assert abs(ours.height - chosen.height) <= 1
    np.testing.assert_allclose(ours.focal, [chosen.focal_length_x, chosen.focal_length_y], rtol=1e-12)
    if (ours.width, ours.height) == (chosen.width, chosen.height):
        np.testing.assert_allclose(ours.center, [chosen.principal_point_x, chosen.principal_point_y], atol=1e-6)
    pixels = pixel_grid(ours.width, ours.height)
    rays = (pixels - ours.center) / ours.focal
    there = theirs.img_from_cam(np.concatenate([rays, np.ones_like(rays[..., :1])], -1).reshape(-1, 3))
    places = np.stack(lens.places(0, ours.height), -1)
    assert np.abs(places.reshape(-1, 2) - there).max() < AGREED / 1000  # the formulas are the same
    assert places.min() > -1
    assert (places.max((0, 1)) < [WIDTH + 1, HEIGHT + 1]).all()


@pytest.mark.parametrize("model", REAL)
def test_a_real_lens_gets_the_camera_that_colmap_gives_it(model: str):
    agrees(model, REAL[model])
    assert undistorted(judge(model, REAL[model])).width == made_of(model, REAL[model]).pinhole.width


@given(cameras())
def test_any_lens_gets_the_camera_that_colmap_gives_it(camera: tuple[str, tuple[float, ...]]):
    if undistortion_of(read(*camera), "camera 1") is not None:
        agrees(*camera)


@pytest.mark.parametrize("model", REAL)
def test_the_picture_is_that_of_image_undistorter(model: str):
    import pycolmap

    photograph = photograph_of(model, REAL[model])
    bitmap = pycolmap.Bitmap.from_array(photograph)
    options = pycolmap.UndistortCameraOptions()
    theirs, _ = pycolmap.undistort_image(options, bitmap, judge(model, REAL[model]))
    ours = made_of(model, REAL[model])(photograph).astype(float)
    assert np.abs(displacements(ours, theirs.to_array().astype(float))).max() < AGREED
    assert np.abs(ours - theirs.to_array()).mean() < 1


@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize("model", REAL)
def test_a_photograph_undistorted_is_what_the_pinhole_sees(model: str, factor: float):
    from PIL import Image

    whole = made_of(model, REAL[model])
    made = whole.at(round(factor * whole.pinhole.width), round(factor * whole.pinhole.height))
    photograph = Image.fromarray(photograph_of(model, REAL[model]))
    if factor < 1:
        photograph = photograph.resize((made.photograph.width, made.photograph.height), Image.Resampling.LANCZOS)
    picture = made(np.array(photograph))
    assert picture.shape == (made.pinhole.height, made.pinhole.width, 3)
    rays = (pixel_grid(made.pinhole.width, made.pinhole.height) - made.pinhole.center) / made.pinhole.focal
    difference = np.abs(picture.astype(float) - pattern(rays))[3:-3, 3:-3]  # splines go on evenly beyond a border
    assert difference.max() <= 4
    assert difference.mean() < 1


def test_hidden_colours_do_not_bleed():
    made = made_of("OPENCV", REAL["OPENCV"])
    photograph = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    photograph[:, :, 0] = 255  # red where it cannot be seen
    photograph[60:180, 80:240] = [0, 200, 100, 255]
    picture = made(photograph)
    seen = picture[..., 3] > 0
    assert seen.any()
    assert not seen.all()
    assert np.abs(picture[seen][:, :3].astype(int) - [0, 200, 100])[picture[seen][:, 3] > 16].max() <= 8
    inside = picture[120, 160]
    assert inside.tolist() == [0, 200, 100, 255]
    assert not picture[~seen].any()


@pytest.mark.parametrize(("share", "bent"), [(0.9, False), (1.1, True)])
def test_what_moves_no_pixel_is_ignored(share: float, bent: bool):
    one = read("SIMPLE_RADIAL", (300.0, 160.0, 120.0, 1e-3))
    unit = farthest_moved(one) / 1e-3
    lens = replace(one.lens, radial=(share * NEGLIGIBLE / unit,))
    assert (undistortion_of(replace(one, lens=lens), "camera 1") is not None) == bent


@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        ("SIMPLE_RADIAL", (300.0, 160.0, 120.0, -1.0)),  # folds within the photograph
        ("SIMPLE_RADIAL", (300.0, 160.0, 120.0, -0.5)),  # folds within COLMAP's picture
        ("SIMPLE_RADIAL", (300.0, 160.0, 120.0, -0.53)),  # shows no pixel of its left side
        ("SIMPLE_RADIAL", (300.0, 160.0, 120.0, 1e6)),
        ("OPENCV", (300.0, 300.0, 160.0, 120.0, 0.0, 0.0, 3.0, 0.0)),
        ("FULL_OPENCV", (300.0, 300.0, 160.0, 120.0, *[0.0] * 5, 30.0, 0.0, 0.0)),
        ("SIMPLE_RADIAL", (300.0, -20.0, 120.0, 0.1)),  # its centre is not in the photograph
        ("OPENCV", (300.0, 300.0, 160.0, 340.0, 0.1, 0.0, 0.0, 0.0)),
        ("OPENCV_FISHEYE", (150.0, 150.0, 160.0, 120.0, -0.9, 0.0, 0.0, 0.0)),
    ],
)
def test_a_lens_that_no_pinhole_can_stand_in_for_is_refused(model: str, parameters: tuple[float, ...]):
    with pytest.raises(
        SceneError, match=rf"^camera 1 has a lens \({model}\) that no pinhole .*; find the cameras again"
    ):
        undistortion_of(read(model, parameters), "camera 1")


FOLDED_CORNERS = {
    "SIMPLE_RADIAL": (300.0, 160.0, 120.0, -0.42),
    "RADIAL": (300.0, 158.0, 123.0, -0.45, 0.04),
    "OPENCV": (290.0, 295.0, 162.0, 117.0, -0.45, 0.06, 0.002, -0.003),
}
"""Lenses that fold the photograph's corners over, and nothing that the picture shows."""


@pytest.mark.parametrize("model", FOLDED_CORNERS)
def test_a_lens_that_folds_only_what_is_cropped_is_taken_as_colmap_takes_it(model: str):
    photograph = read(model, FOLDED_CORNERS[model])
    corner = -np.array(photograph.center)[None] / photograph.focal
    assert np.isnan(photograph.lens.straightened(corner)).any(), "no ray is shown there"
    agrees(model, FOLDED_CORNERS[model])
    made = made_of(model, FOLDED_CORNERS[model])
    corners = [(x, y) for x in (0, made.pinhole.width) for y in (0, made.pinhole.height)]
    rays = (np.array(corners) - made.pinhole.center) / made.pinhole.focal
    assert np.linalg.norm(rays, axis=1).max() < made.photograph.lens.fold


@given(cameras(strong=True))
def test_any_strong_lens_that_is_taken_gets_the_camera_that_colmap_gives_it(camera: tuple[str, tuple[float, ...]]):
    try:
        made = undistortion_of(read(*camera), "camera 1")
    except SceneError:
        return
    if made is not None:
        agrees(*camera)


@pytest.mark.parametrize("focal", [130.0, 100.0, 80.0])
def test_of_a_lens_wider_than_any_picture_the_middle_is_shown(focal: float):
    parameters = (focal, focal, 160.0, 120.0, 0.0, 0.0, 0.0, 0.0)  # the photograph's sides are 70 to 115 degrees off
    agrees("OPENCV_FISHEYE", parameters)


@pytest.mark.parametrize("parameters", [(300.0, 160.0, 120.0, math.nan), (300.0, 160.0, 120.0, 1e9)])
def test_a_coefficient_that_cannot_be_is_refused(parameters: tuple[float, ...]):
    with pytest.raises(SceneError, match=r"^camera 1 has a lens with k1 = "):
        read("SIMPLE_RADIAL", parameters)


@given(cameras())
def test_the_camera_does_not_depend_on_the_size_at_which_the_picture_is_used(camera: tuple[str, tuple[float, ...]]):
    whole = undistortion_of(read(*camera), "camera 1")
    if whole is None:
        return
    half = whole.at(whole.pinhole.width // 2, whole.pinhole.height // 2)
    rays = np.array([[0.0, 0.0], [0.1, -0.05]])
    for one, other in ((whole.pinhole, half.pinhole), (whole.photograph, half.photograph)):
        shares = (one.lens.bent(rays) * one.focal + one.center) / [one.width, one.height]
        same = (other.lens.bent(rays) * other.focal + other.center) / [other.width, other.height]
        np.testing.assert_allclose(shares, same, atol=1e-12)
