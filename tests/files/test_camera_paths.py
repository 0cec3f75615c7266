"""Flights move smoothly through every given camera."""

import math
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_cameras import assert_rigid, camera_at, largest_step, ring

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import interpolated


def random_cameras(count: int, seed: int) -> list[Camera]:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.randn(count, 3, generator=generator) * 3
    targets = torch.randn(count, 3, generator=generator)
    return [camera_at(p, t, 80.0 + 10 * i) for i, (p, t) in enumerate(zip(positions, targets, strict=True))]


@settings(max_examples=25)
@given(count=st.integers(2, 7), extra=st.integers(0, 60), seed=st.integers(0, 99))
def test_a_flight_shows_every_camera_and_stays_rigid(count: int, extra: int, seed: int) -> None:
    cameras = random_cameras(count, seed)
    path = interpolated(cameras, count + extra)
    assert len(path) == count + extra
    assert_rigid(path)
    for camera in cameras:
        assert any(torch.equal(camera.world_to_camera, frame.world_to_camera) for frame in path)
        assert any(camera.focal == frame.focal for frame in path)
    focals = [camera.focal[0] for camera in cameras]
    assert all(min(focals) <= frame.focal[0] <= max(focals) for frame in path)


def test_a_flight_is_continuous_and_about_evenly_fast() -> None:
    cameras = ring(8, torch.zeros(3))
    path = interpolated(cameras, 400)
    length = 2 * math.pi * 3 * 7 / 8
    assert largest_step(path) < 1.5 * length / 400
    # Smooth: the direction of travel never jumps, at the cameras either.
    steps = torch.stack([b.position - a.position for a, b in pairwise(path)])
    steps = torch.nn.functional.normalize(steps, dim=1)
    assert (steps[1:] * steps[:-1]).sum(1).min() > 0.99


def test_the_order_is_the_nearest_neighbours() -> None:
    cameras = [camera_at(torch.tensor([float(x), 5.0, 0.0]), torch.zeros(3)) for x in (0, 3, 1, 2)]
    found = [camera.position[0].item() for camera in interpolated(cameras, 4)]
    assert found == pytest.approx([0, 1, 2, 3], abs=1e-5)


def test_fewer_frames_than_cameras_and_cameras_in_one_place() -> None:
    cameras = ring(8, torch.zeros(3))
    assert len(interpolated(cameras, 3)) == 3
    assert len(interpolated(cameras[:1], 5)) == 5
    twice = interpolated([cameras[0], cameras[0], cameras[1]], 12)
    assert len(twice) == 12
    assert_rigid(twice)


def test_pictures_of_other_sizes_are_brought_to_the_first_one() -> None:
    first, second = ring(2, torch.zeros(3))
    path = interpolated([first, second.resized(128, 96)], 5)
    assert {(camera.width, camera.height) for camera in path} == {(64, 48)}
    assert path[-1].focal == pytest.approx(first.focal)
