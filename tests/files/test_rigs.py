"""Two eyes see by disparity what one sees by depth; all round, each direction is what a pinhole shows there."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_cameras import camera_at

from ringlight.core.camera import Camera
from ringlight.files import rigs
from ringlight.files.rigs import FACES, Panorama, Pinhole, Stereo, comfortable_baseline

CAMERA = camera_at(torch.tensor([3.0, 1.0, 0.5]), torch.tensor([0.0, 0.2, 0.1]))


def points_seen(camera: Camera) -> torch.Tensor:
    """World points in front of a camera, at several depths."""
    local = torch.tensor([[0.1, -0.05, 1.0], [-0.3, 0.2, 2.0], [0.0, 0.0, 5.0]])
    return (local - camera.world_to_camera[:3, 3]) @ camera.world_to_camera[:3, :3]


def column(camera: Camera, point: torch.Tensor) -> tuple[float, float]:
    x, y, z = camera.world_to_camera[:3, :3] @ point + camera.world_to_camera[:3, 3]
    return (camera.focal[0] * x / z + camera.center[0]).item(), (camera.focal[1] * y / z + camera.center[1]).item()


@given(st.floats(0.001, 1.0))
def test_disparity_is_focal_times_baseline_over_depth(baseline: float) -> None:
    left, right = Stereo(baseline).eyes(CAMERA)
    for point in points_seen(CAMERA):
        (x_left, y_left), (x_right, y_right) = column(left, point), column(right, point)
        depth = CAMERA.depths(point[None]).item()
        assert x_left - x_right == pytest.approx(CAMERA.focal[0] * baseline / depth, abs=2e-2)
        assert y_left == pytest.approx(y_right, abs=1e-3)
    middle = (left.position + right.position) / 2
    torch.testing.assert_close(middle, CAMERA.position, atol=1e-5, rtol=0)
    assert (left.position - right.position).norm().item() == pytest.approx(baseline, rel=1e-3, abs=1e-6)


def test_the_left_eye_is_on_the_left() -> None:
    left, right = Stereo(0.5).eyes(CAMERA)
    assert (right.position - left.position) @ CAMERA.world_to_camera[0, :3] > 0
    seen = Stereo(0.5).see(lambda camera: {"color": camera.position.expand(4, 6, 3)}, CAMERA)["color"]
    assert seen.shape == (4, 12, 3)
    torch.testing.assert_close(seen[0, 0], left.position)
    torch.testing.assert_close(seen[0, -1], right.position)


def test_the_nearest_surface_is_thirty_baselines_away() -> None:
    assert comfortable_baseline(6.0) == pytest.approx(0.2)


def test_faces_are_rotations() -> None:
    torch.testing.assert_close(FACES @ FACES.transpose(1, 2), torch.eye(3).expand(6, 3, 3))
    torch.testing.assert_close(torch.linalg.det(FACES), torch.ones(6))
    assert len({tuple(face[2].tolist()) for face in FACES}) == 6


def sphere(camera: Camera) -> dict[str, torch.Tensor]:
    """A world in which every ray shows its own direction, on a sphere of radius 7 about the camera."""
    directions = camera.ray_directions()
    return {"color": directions, "depth": 7.0 * (directions @ camera.forward)[..., None]}


@pytest.mark.parametrize("width", [64, 200])
def test_every_direction_is_where_it_belongs(width: int) -> None:
    rig = Panorama(width)
    seen = rig.see(sphere, CAMERA)
    wanted = rig.directions() @ CAMERA.world_to_camera[:3, :3]
    assert seen["color"].shape == (width // 2, width, 3)
    angle = torch.rad2deg(
        torch.acos((torch.nn.functional.normalize(seen["color"], dim=-1) * wanted).sum(-1).clamp(-1, 1))
    )
    assert angle.max() < 0.05 * 360 / width + 0.1, "the share of a pixel that linear interpolation leaves, and rounding"
    torch.testing.assert_close(seen["depth"], torch.full_like(seen["depth"], 7.0), rtol=1e-3, atol=0)


def test_the_middle_is_ahead_and_the_right_is_right() -> None:
    directions = Panorama(400).directions()
    middle = directions[99:101, 199:201].mean((0, 1))
    torch.testing.assert_close(middle, torch.tensor([0.0, 0.0, 1.0]), atol=1e-3, rtol=0)
    assert directions[100, 300, 0] > 0.99
    assert directions[0, 200, 1] < -0.99, "the upper edge is up, and down is positive"
    torch.testing.assert_close(directions.norm(dim=-1), torch.ones(200, 400))


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 60))
def test_small_panoramas_are_whole(half: int) -> None:
    seen = Panorama(2 * half).see(sphere, CAMERA)
    assert seen["color"].norm(dim=-1).min() > 0.5, "no pixel was left out"
    assert seen["color"].shape == (half, 2 * half, 3)


def test_normals_and_depths_are_not_mixed() -> None:
    def halves(camera: Camera) -> dict[str, torch.Tensor]:
        near = camera.ray_directions()[..., :1] > 0
        return {
            "normal": torch.where(near, torch.tensor([0.0, 0, 1]), torch.tensor([0.0, 1, 0])),
            "color": near.float(),
        }

    seen = Panorama(100).see(halves, CAMERA)
    assert seen["normal"].norm(dim=-1).allclose(torch.ones(1))
    assert ((seen["color"] > 0.01) & (seen["color"] < 0.99)).any(), "colours are"


def test_a_pinhole_is_itself() -> None:
    assert Pinhole().see(sphere, CAMERA)["color"].equal(sphere(CAMERA)["color"])
    assert Pinhole().size(CAMERA) == (64, 48)
    assert Stereo(1.0).size(CAMERA) == (128, 48)
    assert Panorama(100).size(CAMERA) == (100, 50)
    face = Panorama(100).faces(CAMERA)[0]
    assert math.degrees(2 * math.atan(math.ceil(100 / math.pi) / 2 / face.focal[0])) == pytest.approx(90)


@pytest.mark.parametrize("pixels", [1, 100, 4096])
def test_bands_make_the_whole(pixels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture that is one band, and one of bands of a row or a few."""

    def look(camera: Camera) -> dict[str, torch.Tensor]:
        rays = camera.ray_directions() @ torch.tensor([[1.0, 2.0, 0.5], [0.0, 1.0, 1.0], [3.0, 0.0, 1.0]])
        return {"color": rays.sin(), "depth": 2 + rays[..., :1].cos(), "normal": rays.cos()}

    whole = Panorama(64).see(look, CAMERA)
    monkeypatch.setattr(rigs, "BAND_PIXELS", pixels)
    banded = Panorama(64).see(look, CAMERA)
    assert whole.keys() == banded.keys()
    for name in whole:
        assert whole[name].shape[:2] == (32, 64)
        torch.testing.assert_close(banded[name], whole[name], rtol=0, atol=1e-6)


@given(st.integers(1, 300), st.integers(1, 300), st.integers(1, 5000))
def test_bands_cover_every_row_once_and_are_bounded(height: int, width: int, pixels: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rigs, "BAND_PIXELS", pixels)
        found = [range(height)[rows] for rows in rigs.bands(height, width)]
    assert [row for rows in found for row in rows] == list(range(height))
    assert all(len(rows) == 1 or len(rows) * width <= pixels for rows in found)
