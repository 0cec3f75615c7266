"""Films move smoothly: level circles round the subject, flights that pass through every given camera."""

import math
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import interpolated, orbit

UP = torch.tensor([0.0, 0.0, 1.0])


def camera_at(position: torch.Tensor, target: torch.Tensor, focal: float = 100.0) -> Camera:
    forward = torch.nn.functional.normalize(target - position, dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, UP), dim=0)
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.stack([right, torch.linalg.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return Camera(matrix, (focal, focal), (32.0, 24.0), 64, 48)


def ring(count: int, target: torch.Tensor, radius: float = 3.0, height: float = 1.0) -> list[Camera]:
    angles = [2 * math.pi * i / count for i in range(count)]
    return [
        camera_at(target + torch.tensor([radius * math.cos(a), radius * math.sin(a), height]), target) for a in angles
    ]


def random_cameras(count: int, seed: int) -> list[Camera]:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.randn(count, 3, generator=generator) * 3
    targets = torch.randn(count, 3, generator=generator)
    return [camera_at(p, t, 80.0 + 10 * i) for i, (p, t) in enumerate(zip(positions, targets, strict=True))]


def assert_rigid(path: list[Camera]) -> None:
    for camera in path:
        rotation = camera.world_to_camera[:3, :3]
        torch.testing.assert_close(rotation @ rotation.T, torch.eye(3), atol=1e-5, rtol=0)
        assert torch.linalg.det(rotation) > 0
        assert camera.world_to_camera.isfinite().all()


def largest_step(path: list[Camera]) -> float:
    return max((a.position - b.position).norm().item() for a, b in pairwise(path))


def test_an_orbit_finds_the_circle_it_was_shown() -> None:
    target = torch.tensor([0.5, -0.25, 0.1])
    path = orbit(ring(12, target), 24)
    assert len(path) == 24
    assert_rigid(path)
    # The first camera of the ring begins the orbit, and every second frame is a camera of the ring.
    torch.testing.assert_close(path[0].world_to_camera, ring(12, target)[0].world_to_camera, atol=1e-4, rtol=0)
    for camera in path:
        away = camera.position - target
        assert away[:2].norm().item() == pytest.approx(3.0, abs=1e-3)
        assert away[2].item() == pytest.approx(1.0, abs=1e-3)
        torch.testing.assert_close(camera.forward, -away / away.norm(), atol=1e-3, rtol=0)
    closing = (path[-1].position - path[0].position).norm().item()
    assert closing == pytest.approx(largest_step(path), rel=1e-3)


@pytest.mark.parametrize(
    "cameras",
    [
        [camera_at(torch.tensor([3.0, 0.0, 1.0]), torch.zeros(3))],
        # Parallel axes have no nearest point, and a camera almost overhead has almost no radius.
        [camera_at(torch.tensor([x, 0.0, 0.0]), torch.tensor([x, 5.0, 0.0])) for x in (-1.0, 0.0, 1.0)],
        [camera_at(torch.tensor([1e-4, 0.0, 4.0]), torch.zeros(3))],
        ring(6, torch.zeros(3)) + ring(3, torch.zeros(3), height=-2.0),
    ],
    ids=["one", "parallel", "overhead", "above and below"],
)
def test_an_orbit_of_awkward_cameras_is_still_a_path(cameras: list[Camera]) -> None:
    path = orbit(cameras, 16)
    assert_rigid(path)
    assert len({tuple(camera.position.tolist()) for camera in path}) == 16


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
