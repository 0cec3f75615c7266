"""A path that was clicked together is the path that is rendered."""

from pathlib import Path

import numpy as np
import pytest
import torch

from ringlight.files.camera_paths import position_of
from ringlight.files.nerfstudio_path import read_nerfstudio_path
from ringlight.view.key_frames import FPS, LONGEST, KeyFrames
from tiny_scene import tiny_scene

CAMERAS = [view.camera.resized(64, 48) for view in tiny_scene(views=5, size=24).train]


def keys() -> KeyFrames:
    found = KeyFrames()
    # Back and forth: an order that a tour of nearest neighbours would not take.
    for index in (0, 3, 1):
        found.add(CAMERAS[index])
    return found


def test_a_written_path_is_the_film(tmp_path: Path):
    path = keys().write(tmp_path, 2.0)
    again, film = read_nerfstudio_path(path, 1000), keys().film(2.0)
    assert again.fps == FPS
    assert len(again.cameras) == len(film) == 60
    for ours, theirs in zip(film, again.cameras, strict=True):
        assert torch.allclose(ours.world_to_camera, theirs.world_to_camera, atol=1e-5)
        assert theirs.focal[1] == pytest.approx(ours.focal[1], rel=1e-6)
        assert (theirs.width, theirs.height) == (64, 48)


def test_the_film_passes_the_key_frames_in_their_order():
    film = keys().film(3.0)
    at = [
        int(np.argmin([np.linalg.norm(position_of(frame) - position_of(CAMERAS[index])) for frame in film]))
        for index in (0, 3, 1)
    ]
    assert at == sorted(at)
    assert (at[0], at[-1]) == (0, len(film) - 1)
    for index, place in zip((0, 3, 1), at, strict=True):
        assert torch.allclose(film[place].world_to_camera, CAMERAS[index].world_to_camera)


def test_each_path_is_a_new_file(tmp_path: Path):
    first, second = keys().write(tmp_path, 1.0), keys().write(tmp_path, 1.0)
    assert first != second
    assert first.read_bytes() == second.read_bytes()


def test_none_one_and_two():
    found = KeyFrames()
    found.drop()
    assert found.film(2.0) == []
    assert len(found.way()) == 0
    found.add(CAMERAS[0])
    assert len(found.film(2.0)) == 60
    assert len(found.way()) == 0
    found.add(CAMERAS[1])
    assert len(found.way()) == 100
    found.drop()
    assert len(found.cameras) == 1


def test_windows_of_other_sizes_keep_the_field_of_view():
    found = keys()
    found.add(CAMERAS[2].resized(640, 96))
    last = found.cameras[-1]
    assert (last.width, last.height, last.center) == (64, 48, (32, 24))
    assert last.focal[1] / last.height == pytest.approx(CAMERAS[2].focal[1] / 48)


def test_a_film_is_neither_endless_nor_empty():
    still = KeyFrames()
    still.add(CAMERAS[0])
    assert len(still.film(1e9)) == LONGEST * FPS
    assert len(still.film(-1.0)) == FPS
