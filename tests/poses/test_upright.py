"""Which way is up: level cameras, turned photographs, rolled cameras; always a rotation to +z."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from textured_room import shots

from ringlight.poses.upright import find_up, rotation_to_z


def cameras(count: int, roll: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    taken = shots(count, roll)
    return np.stack([shot.rotation for shot in taken]), np.stack([shot.center for shot in taken])


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


@given(st.integers(0, 10_000))
def test_level_cameras_give_up_exactly_in_any_frame(seed: int):
    turn = Rotation.random(random_state=seed).as_matrix()
    rotations, centers = cameras(12)
    up = find_up(rotations @ turn.T, centers @ turn.T, [1] * 12)
    assert degrees_between(up.direction, turn @ [0, 0, 1]) < 0.01
    assert "level" in up.reason


@pytest.mark.parametrize(("tag", "quarters"), [(3, 2), (6, 1), (8, 3)])
def test_photographs_that_exif_turns_are_taken_as_they_were_held(tag: int, quarters: int):
    rotations, centers = cameras(12)
    # Shown after a clockwise turn, the picture has its right side where its stored top was.
    turned = np.linalg.matrix_power(np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), quarters)
    stored = np.stack([turned @ rotation for rotation in rotations])
    stored[::2] = rotations[::2]  # half of them in landscape
    up = find_up(stored, centers, [1, tag] * 6)
    assert degrees_between(up.direction, np.array([0, 0, 1.0])) < 0.01
    assert "6 photographs turned by the EXIF orientation" in up.reason


def test_cameras_that_all_look_one_way_take_the_mean_of_their_up_axes():
    rotations, centers = cameras(2)
    up = find_up(np.repeat(rotations[:1], 5, 0), np.repeat(centers[:1], 5, 0), [1] * 5)
    assert degrees_between(up.direction, -rotations[0, 1]) < 1e-4
    assert "mean" in up.reason


def test_rolled_cameras_on_a_circle_take_its_plane():
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    centers = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    rotations = []
    for index, center in enumerate(centers):
        right = np.cross(-center, [0, 0, 1])
        level = np.stack([right, np.cross(-center, right), -center])
        rotations.append(Rotation.from_euler("z", [60, -60, 20][index % 3], degrees=True).as_matrix() @ level)
    up = find_up(np.stack(rotations), centers, [1] * 24)
    assert degrees_between(up.direction, np.array([0, 0, 1.0])) < 0.01
    assert "plane" in up.reason


@given(arrays(np.float64, 3, elements=st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 1e-3))
@example(np.array([1e-6, 0, -0.5]))
@example(np.array([1e-200, 0, -1]))
def test_the_rotation_takes_up_to_z_and_is_one(vector: np.ndarray):
    up = vector / np.linalg.norm(vector)
    turn = rotation_to_z(up)
    np.testing.assert_allclose(turn @ up, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
