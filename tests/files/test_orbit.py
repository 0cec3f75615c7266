"""Orbits are level, go round the subject, and stay where photographs were taken."""

import math
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_cameras import assert_rigid, camera_at, largest_step, ring

from ringlight.core.camera import Camera
from ringlight.errors import RecipeError
from ringlight.files.orbit import WIDEST_GAP, OrbitWish, orbit_of, showing_whole

TARGET = torch.tensor([0.5, -0.25, 0.1])


def arc(degrees: list[float], radius: float = 3.0) -> list[Camera]:
    places = [(radius * math.cos(math.radians(a)), radius * math.sin(math.radians(a))) for a in degrees]
    return [camera_at(TARGET + torch.tensor([x, y, 1.0]), TARGET) for x, y in places]


def azimuth(camera: Camera) -> float:
    x, y, _ = (camera.position - TARGET).tolist()
    return math.degrees(math.atan2(y, x))


def apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def test_an_orbit_finds_the_circle_it_was_shown() -> None:
    target = TARGET
    path = orbit_of(ring(12, target)).cameras(24)
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
    path = orbit_of(cameras).cameras(16)
    assert_rigid(path)
    assert largest_step(path) > 0, "a film of it moves"


@settings(max_examples=50)
@given(
    turn=st.floats(0, 360),
    width=st.floats(20, 250),
    count=st.integers(6, 30),
    frames=st.integers(1, 40),
)
def test_an_orbit_stays_within_a_photographed_arc(turn: float, width: float, count: int, frames: int) -> None:
    photographed = arc([turn + width * i / (count - 1) for i in range(count)])
    found = orbit_of(photographed)
    assert found.arc == pytest.approx(width, abs=0.1)
    path = found.cameras(frames)
    assert apart(azimuth(path[0]), turn + width / 2) < 0.1, "it begins in the middle"
    assert max(apart(azimuth(camera), turn + width / 2) for camera in path) <= width / 2 + 0.1
    # Half of the largest gap that is crossed.
    assert all(min(apart(azimuth(c), azimuth(p)) for p in photographed) <= WIDEST_GAP / 2 + 0.1 for c in path)


def test_a_swing_closes_without_a_jump() -> None:
    path = orbit_of(arc([10.0 * i for i in range(10)])).cameras(60)
    closing = (path[-1].position - path[0].position).norm().item()
    assert closing <= largest_step(path) + 1e-6
    assert any(apart(azimuth(c), 0) < 1 for c in path)
    assert any(apart(azimuth(c), 90) < 1 for c in path)


def test_of_two_arcs_the_one_with_more_photographs_is_taken() -> None:
    found = orbit_of(arc([0.0, 20.0, 40.0, 170.0, 180.0, 190.0, 200.0]))
    assert found.arc == pytest.approx(30, abs=0.1)
    assert apart(azimuth(found.cameras(1)[0]), 185) < 0.1


def test_a_camera_overhead_is_on_no_side() -> None:
    overhead = camera_at(TARGET + torch.tensor([0.0, -0.01, 4.0]), TARGET)
    assert orbit_of([*arc([0.0, 30.0, 60.0]), overhead]).arc == pytest.approx(60, abs=0.5)


def test_a_wish_is_obeyed() -> None:
    wish = OrbitWish(center=(1.0, 2.0, 3.0), radius=5.0, height=-2.0, arc=360.0)
    path = orbit_of(arc([0.0, 30.0, 60.0]), wish).cameras(8)
    assert_rigid(path)
    center = torch.tensor([1.0, 2.0, 3.0])
    for camera in path:
        away = camera.position - center
        assert away[2].item() == pytest.approx(-2.0, abs=1e-4)
        assert away[:2].norm().item() == pytest.approx(5.0, abs=1e-4)
        torch.testing.assert_close(camera.forward, -away / away.norm(), atol=1e-4, rtol=0)
    steps = [(a.position - b.position).norm().item() for a, b in pairwise([*path, path[0]])]
    assert steps == pytest.approx([steps[0]] * 8, rel=1e-3)
    assert orbit_of(arc([0.0, 30.0, 60.0]), OrbitWish(arc=20.0)).arc == 20


@pytest.mark.parametrize(
    ("wish", "flag"),
    [
        ({"center": (0.0, math.nan, 0.0)}, "--center"),
        ({"center": (1e300, 0.0, 0.0)}, "--center"),
        ({"radius": 0.0}, "--radius"),
        ({"radius": math.inf}, "--radius"),
        ({"height": math.nan}, "--height"),
        ({"arc": 0.0}, "--arc"),
        ({"arc": 361.0}, "--arc"),
    ],
)
def test_what_is_no_orbit_is_refused(wish: dict, flag: str) -> None:
    with pytest.raises(RecipeError, match=flag):
        OrbitWish(**wish)


def test_an_orbit_that_looks_straight_down_is_refused() -> None:
    with pytest.raises(RecipeError, match="straight down"):
        orbit_of(arc([0.0, 30.0]), OrbitWish(radius=1e-6, height=2.0))


@settings(max_examples=30)
@given(seed=st.integers(0, 999), size=st.floats(0.05, 2.5))
def test_a_subject_is_whole_in_every_frame(seed: int, size: float) -> None:
    points = TARGET + size * (2 * torch.rand(400, 3, generator=torch.Generator().manual_seed(seed)) - 1) / math.sqrt(3)
    cameras = orbit_of(ring(12, TARGET, radius=4.0)).cameras(12)
    zoom = showing_whole(cameras, points)
    assert 0 < zoom <= 1
    cut = 0
    for camera in cameras:
        closer = Camera(
            camera.world_to_camera,
            (camera.focal[0] * zoom, camera.focal[1] * zoom),
            camera.center,
            camera.width,
            camera.height,
        )
        cut += int((~closer.pixels(points)[2]).sum())
    assert cut <= 0.02 * 400 * 12, "but for floaters at each edge"
    if zoom < 1:
        assert showing_whole(
            [
                Camera(c.world_to_camera, (c.focal[0] * zoom, c.focal[1] * zoom), c.center, c.width, c.height)
                for c in cameras
            ],
            points,
        ) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 3e4])
def test_an_orbit_is_told_in_numbers_that_can_be_typed(scale: float) -> None:
    wish = OrbitWish(center=(-0.5e-4 * scale, 1e-9 * scale, -3.0 * scale), radius=2.0 * scale, height=-1e-3 * scale)
    words = orbit_of(arc([0.0, 30.0, 60.0]), wish).words().split()
    assert not [word for word in words if "e" in word and not word.startswith("--")]
    x, y, z = (float(word) for word in words[1:4])
    assert abs(x + 0.5e-4 * scale) <= 1e-3 * scale
    assert words[2].strip("0.") == "", "no minus before a zero"
    assert y == 0
    assert z == pytest.approx(-3.0 * scale)
    assert float(words[words.index("--radius") + 1]) == pytest.approx(2 * scale)
