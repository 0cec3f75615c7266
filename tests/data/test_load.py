"""Choosing a format, and one sentence for each folder that is no scene."""

import os
from pathlib import Path

import pytest
from scene_folders import write_blender, write_colmap, write_nerfstudio

from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import SceneError
from shared_data import shared


@pytest.mark.parametrize(
    ("write", "name"), [(write_blender, "blender"), (write_colmap, "colmap"), (write_nerfstudio, "nerfstudio")]
)
def test_each_format_is_recognised(tmp_path: Path, write, name: str):
    scene = load_scene(write(tmp_path / "garden"))
    assert (scene.format, scene.name, scene.source) == (name, "garden", str(tmp_path / "garden"))
    assert min(len(scene.train), len(scene.test), len(scene.points.positions)) > 0


def test_the_source_is_the_same_wherever_one_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = write_blender(tmp_path / "garden")
    monkeypatch.chdir(tmp_path)
    assert load_scene("garden").source == load_scene(folder).source == str(folder)


def test_the_format_can_be_forced(tmp_path: Path):
    write_colmap(tmp_path)
    write_nerfstudio(tmp_path)
    assert load_scene(tmp_path).format == "colmap"
    assert load_scene(tmp_path, SceneOptions(format="nerfstudio")).format == "nerfstudio"


def test_a_forced_format_that_is_not_there_names_the_one_that_is(tmp_path: Path):
    write_blender(tmp_path)
    with pytest.raises(SceneError, match=r"looked for transforms\.json; it looks like --format blender"):
        load_scene(tmp_path, SceneOptions(format="nerfstudio"))


def test_a_missing_folder_a_file_and_an_empty_folder_are_named(tmp_path: Path):
    with pytest.raises(SceneError, match="nowhere: no such folder"):
        load_scene(tmp_path / "nowhere")
    file = tmp_path / "transforms.json"
    file.write_text("{}")
    with pytest.raises(SceneError, match="is a file, not a folder"):
        load_scene(file)
    (tmp_path / "empty").mkdir()
    looked_for = r"looked for sparse/0/cameras\.bin or \.txt, transforms_train\.json, transforms\.json"
    with pytest.raises(SceneError, match=looked_for):
        load_scene(str(tmp_path / "empty"))


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_a_folder_without_permission_is_one_sentence(tmp_path: Path):
    folder = write_blender(tmp_path / "scene")
    folder.chmod(0)
    try:
        with pytest.raises(SceneError, match="cannot be read"):
            load_scene(folder)
    finally:
        folder.chmod(0o700)


@pytest.mark.parametrize(
    ("path", "train", "test"),
    [
        ("chair_400", 100, 50),
        ("lego_400", 100, 50),
        ("toaster_400", 100, 30),
        ("carpaint_200", 100, 30),
        ("maryrose_400", 60, 9),
        ("bundle/toaster_200", 50, 10),
        ("bundle/carpaint_200", 50, 10),
        ("family_24", 21, 3),
    ],
)
def test_shared_scenes_have_their_splits(path: str, train: int, test: int):
    scene = load_scene(shared(f"data/{path}"))
    assert (len(scene.train), len(scene.test)) == (train, test)
    assert scene.background == ("photograph" if path == "family_24" else "white")
    view = scene.test[-1]
    assert view.image(scene.background_color).shape == (3, view.camera.height, view.camera.width)
