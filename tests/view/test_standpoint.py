"""A browser's camera and ours are the same pinhole."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import position_of, rotation_of
from ringlight.view.standpoint import Standpoint, is_same_pose, looked_at, standpoint_at
from tiny_scene import tiny_scene

CAMERA = tiny_scene(views=4, size=24).train[1].camera


def test_there_and_back():
    point = standpoint_at(CAMERA, 48, 48)
    again = point.camera()
    assert torch.allclose(again.world_to_camera, CAMERA.world_to_camera, atol=1e-6)
    assert again.focal == pytest.approx((2 * CAMERA.focal[0], 2 * CAMERA.focal[1]))
    assert (again.width, again.height, again.center) == (48, 48, (24, 24))
    small = point.camera(0.25)
    assert (small.width, small.height) == (12, 12)
    assert small.focal == pytest.approx((CAMERA.focal[0] / 2, CAMERA.focal[1] / 2))


@given(st.integers(600, 3000), st.integers(200, 3000), st.integers(1, 3))
def test_each_strip_of_a_window_of_any_shape_shows_all_of_the_photograph(width: int, height: int, strips: int):
    seen = standpoint_at(CAMERA, width, height, strips).camera()
    assert (seen.width, seen.height) == (width, height)
    for axis, (mine, side) in enumerate(((width / strips, CAMERA.width), (height, CAMERA.height))):
        assert mine / seen.focal[axis] >= side / CAMERA.focal[axis] * (1 - 1e-6)


def test_an_unturned_camera_looks_along_z_with_y_down():
    camera = Standpoint((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), math.pi / 2, 100, 80).camera()
    assert torch.equal(camera.world_to_camera[:3, :3], torch.eye(3))
    assert camera.position.tolist() == [1, 2, 3]
    assert camera.focal == pytest.approx((40, 40))


@pytest.mark.parametrize(
    "change",
    [
        {"fov": math.nan},
        {"fov": 0.0},
        {"fov": 4.0},
        {"width": 0},
        {"height": -1},
        {"position": (math.inf, 0.0, 0.0)},
        {"position": (1e39, 0.0, 0.0)},
        {"wxyz": (0.0, 0.0, 0.0, 0.0)},
        {"wxyz": (1e-200, 0.0, 0.0, 0.0)},
    ],
)
def test_what_no_picture_can_be_made_of_is_not_usable(change: dict):
    good = {"position": (0.0, 0.0, 0.0), "wxyz": (1.0, 0.0, 0.0, 0.0), "fov": 1.0, "width": 10, "height": 10}
    assert Standpoint(**good).is_usable
    assert not Standpoint(**(good | change)).is_usable


def test_the_same_pose_is_told_from_its_neighbours():
    def moved(by: float) -> Camera:
        matrix = CAMERA.world_to_camera.clone()
        matrix[0, 3] += by
        return Camera(matrix, CAMERA.focal, CAMERA.center, CAMERA.width, CAMERA.height)

    def turned(degrees: float) -> Camera:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn = torch.eye(4)
        turn[0, 0], turn[0, 2], turn[2, 0], turn[2, 2] = c, s, -s, c
        return Camera(turn @ CAMERA.world_to_camera, CAMERA.focal, CAMERA.center, CAMERA.width, CAMERA.height)

    assert is_same_pose(CAMERA, moved(0.001), 1.0)
    assert not is_same_pose(CAMERA, moved(0.01), 1.0)
    assert is_same_pose(CAMERA, moved(0.01), 10.0)
    # A turn about the camera's own place: its position in the world stays.
    assert not is_same_pose(CAMERA, turned(1.0), 1.0)
    assert is_same_pose(CAMERA, turned(0.1), 1.0)
    assert not is_same_pose(CAMERA, turned(180), 1.0)


def test_what_is_looked_at_lies_on_the_axis_in_front():
    for center in (np.zeros(3), position_of(CAMERA) - 5 * rotation_of(CAMERA)[2], position_of(CAMERA)):
        offset = looked_at(CAMERA, center) - position_of(CAMERA)
        depth = offset @ rotation_of(CAMERA)[2]
        assert depth > 0
        assert np.allclose(offset, depth * rotation_of(CAMERA)[2])
