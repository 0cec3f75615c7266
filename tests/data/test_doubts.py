"""Scenes that would train to a blank picture say why beforehand."""

import json
from pathlib import Path

import numpy as np
import pytest
from scene_folders import nerfstudio_document, write_blender, write_colmap, write_nerfstudio

from ringlight.data.doubts import NEAREST
from ringlight.data.load import load_scene
from ringlight.rasterize.convention import NEAR
from shared_data import shared


def ply(points: np.ndarray) -> str:
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    return head + "end_header\n" + "\n".join(" ".join(map(str, point)) for point in points.tolist()) + "\n"


def warnings(folder: Path) -> list[str]:
    return [note for note in load_scene(folder).notes if note.startswith("warning") and "bytes" not in note]


def test_points_that_no_camera_sees_are_said(tmp_path: Path):
    folder = write_nerfstudio(tmp_path)
    far, near = np.array([[0, 0, 300.0]] * 5), np.random.default_rng(0).normal(0, 0.1, (5, 3))
    (folder / "sparse_pc.ply").write_text(ply(far + near))
    assert any("all points to start from are seen by no camera" in note for note in warnings(folder))
    (folder / "sparse_pc.ply").write_text(ply(np.concatenate([far + near, near[:4]])))
    assert any("56% of the points to start from are seen by no camera" in note for note in warnings(folder))
    (folder / "sparse_pc.ply").write_text(ply(np.concatenate([far, near, near])))
    assert warnings(folder) == []


def test_points_in_one_place_are_said(tmp_path: Path):
    folder = write_nerfstudio(tmp_path)
    (folder / "sparse_pc.ply").write_text(ply(np.full((9, 3), 0.25)))
    assert any("all points to start from lie in one place" in note for note in warnings(folder))


def test_a_camera_far_from_all_others_is_named(tmp_path: Path):
    document = nerfstudio_document()
    document["frames"][3]["transform_matrix"][0][3] = 9e8
    found = warnings(write_nerfstudio(tmp_path, document))
    assert any("the camera of images/0003.png stands" in note for note in found)
    (tmp_path / "transforms.json").write_text(json.dumps(nerfstudio_document()))
    assert warnings(tmp_path) == []


@pytest.mark.parametrize(("scale", "said"), [(1.0, None), (1e-3, "by 1,000"), (1e-6, "by 1,000,000")])
def test_a_scene_that_is_nearer_than_what_is_drawn_is_said(tmp_path: Path, scale: float, said: str | None):
    document = nerfstudio_document()
    for frame in document["frames"]:
        for row in range(3):
            frame["transform_matrix"][row][3] *= scale
    found = warnings(write_nerfstudio(tmp_path, document))
    assert found == [] if said is None else any("are not drawn" in note and note.endswith(said) for note in found)


def test_doubts_know_where_rasterizers_begin_to_draw():
    assert NEAREST == NEAR


@pytest.mark.parametrize(("offset", "said"), [(1e4, False), (1e7, True)])
def test_a_scene_far_from_the_origin_is_said(tmp_path: Path, offset: float, said: bool):
    document = nerfstudio_document()
    for frame in document["frames"]:
        frame["transform_matrix"][0][3] += offset
    found = warnings(write_nerfstudio(tmp_path, document))
    assert any("single precision blurs that" in note for note in found) is said


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("has_points", [False, True])
def test_cameras_that_turn_in_one_place_are_no_doubt(tmp_path: Path, noise: float, has_points: bool):
    drawn = np.random.default_rng(0)
    document = nerfstudio_document()
    for frame in document["frames"]:
        for row, place in enumerate((1.0, 2.0, 3.0)):
            frame["transform_matrix"][row][3] = place + noise * drawn.normal()
    folder = write_nerfstudio(tmp_path, document)
    if has_points:
        around = drawn.normal(size=(500, 3))
        around *= 5 / np.linalg.norm(around, axis=1, keepdims=True)
        (folder / "sparse_pc.ply").write_text(ply(around + np.array([1, 2, 3])))
    assert not any("drawn" in note or "origin" in note for note in warnings(folder))


def test_random_points_that_no_camera_sees_are_no_doubt(tmp_path: Path):
    document = nerfstudio_document()
    for frame in document["frames"]:  # all from one place, each another way
        for row in range(3):
            frame["transform_matrix"][row][3] = 0.0
    document["camera_angle_x"] = 0.05
    assert load_scene(write_nerfstudio(tmp_path, document)).points.measured is False
    assert warnings(tmp_path) == []


@pytest.mark.parametrize("write", [write_blender, write_colmap, write_nerfstudio])
def test_plain_scenes_raise_no_doubts(tmp_path: Path, write):
    assert warnings(write(tmp_path)) == []


@pytest.mark.parametrize("path", ["chair_400", "toaster_400", "bundle/carpaint_200", "family_24"])
def test_shared_scenes_raise_no_doubts(path: str):
    assert warnings(shared(f"data/{path}")) == []
