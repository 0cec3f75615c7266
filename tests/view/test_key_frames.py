"""A path that was clicked together is the path that is rendered."""

from pathlib import Path

import numpy as np
import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import position_of
from ringlight.files.key_frame_flight import flown, frame_times
from ringlight.files.key_frames import holds_key_frames, read_key_frames
from ringlight.files.nerfstudio_path import read_nerfstudio_path
from ringlight.view.key_frames import FILES, FPS, FRAMES, LONGEST, STOPS, Keys
from tiny_scene import tiny_scene

CAMERAS = [view.camera.resized(64, 48) for view in tiny_scene(views=5, size=24).train]


def keys(*order: int) -> Keys:
    """By default back and forth: an order that a tour of nearest neighbours would not take."""
    found = Keys()
    for index in order or (0, 3, 1):
        found.add(CAMERAS[index])
    return found


def rendered(path: Path) -> list[Camera]:
    """The cameras of `ringlight render --path`, whatever the file holds."""
    if not holds_key_frames(path):
        found = read_nerfstudio_path(path, 10_000)
        assert found.fps == FPS
        return list(found.cameras)
    flight = read_key_frames(path, None, None)
    return flown(flight, frame_times(flight, None, flight.fps, 10_000))


@pytest.mark.parametrize("holds", FILES)
@pytest.mark.parametrize("order", [(0, 3, 1), (2,), (1, 1, 4), (0, 2)])
def test_a_written_path_is_the_film_of_the_preview(holds: str, order: tuple[int, ...], tmp_path: Path):
    found = keys(*order)
    film, again = found.film(2.0), rendered(found.write(tmp_path, 2.0, holds))
    assert len(again) == len(film) == (1 if len(order) == 1 else 61)
    for ours, theirs in zip(film, again, strict=True):
        assert torch.allclose(ours.world_to_camera, theirs.world_to_camera, atol=1e-5)
        assert theirs.focal == pytest.approx(ours.focal, rel=1e-6)
        assert (theirs.width, theirs.height) == (64, 48)


def test_the_two_files_differ(tmp_path: Path):
    assert holds_key_frames(keys().write(tmp_path, 2.0, STOPS))
    assert not holds_key_frames(keys().write(tmp_path, 2.0, FRAMES))


def test_the_film_passes_the_key_frames_in_their_order():
    film = keys().film(3.0)
    for index, frame in zip((0, 3, 1), (0, 45, 90), strict=True):
        assert torch.allclose(film[frame].world_to_camera, CAMERAS[index].world_to_camera, atol=1e-5)


def test_each_path_is_a_new_file(tmp_path: Path):
    first, second = keys().write(tmp_path, 1.0), keys().write(tmp_path, 1.0)
    assert first != second
    assert first.read_bytes() == second.read_bytes()


def test_none_one_and_two():
    found = Keys()
    found.drop()
    assert found.film(2.0) == []
    assert len(found.way()) == 0
    found.add(CAMERAS[0])
    assert [camera.width for camera in found.film(2.0)] == [64], "a still"
    assert len(found.way()) == 0
    found.add(CAMERAS[1])
    assert len(found.way()) == 100
    found.drop()
    assert len(found.cameras) == 1


def test_the_way_is_that_of_the_film():
    film = keys().film(3.3)
    assert len(film) == 100
    assert np.allclose(keys().way(), [position_of(camera) for camera in film], atol=1e-5)


def test_windows_of_other_sizes_keep_the_field_of_view():
    found = keys()
    found.add(CAMERAS[2].resized(640, 96))
    last = found.cameras[-1]
    assert (last.width, last.height, last.center) == (64, 48, (32, 24))
    assert last.focal[1] / last.height == pytest.approx(CAMERAS[2].focal[1] / 48)


def test_a_film_is_neither_endless_nor_empty():
    assert len(keys().film(1e9)) == LONGEST * FPS + 1
    assert len(keys().film(-1.0)) == FPS + 1
