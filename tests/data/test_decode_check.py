"""Damaged photographs are found before the first step, or beside the first ones."""

from pathlib import Path

import numpy as np
import pytest
from scene_folders import write_blender

from ringlight.core.stages import heard_by
from ringlight.data.decode_check import DecodeCheck
from ringlight.data.load import load_scene
from ringlight.errors import SceneError


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:150])


@pytest.mark.parametrize("split", ["train", "test"])
def test_a_damaged_photograph_is_found_at_once(tmp_path: Path, split: str):
    cut(write_blender(tmp_path) / split / "r_1.png")
    with pytest.raises(SceneError, match=rf"{split}/r_1\.png: not a readable image"):
        DecodeCheck(load_scene(tmp_path))


@pytest.mark.parametrize("split", ["train", "test"])
def test_without_time_it_is_found_beside_the_training(tmp_path: Path, split: str):
    cut(write_blender(tmp_path) / split / "r_1.png")
    check = DecodeCheck(load_scene(tmp_path), seconds=0.0)
    check.wait()
    with pytest.raises(SceneError, match=rf"{split}/r_1\.png: not a readable image"):
        check.refuse_damaged()


@pytest.mark.parametrize("seconds", [0.0, 60.0])
def test_whole_photographs_pass_and_those_of_training_are_kept(tmp_path: Path, seconds: float):
    scene = load_scene(write_blender(tmp_path))
    check = DecodeCheck(scene, seconds)
    check.wait()
    check.refuse_damaged()
    for path in tmp_path.rglob("*.png"):
        path.unlink()
    fresh = load_scene(write_blender(tmp_path / "again"))
    for view, other in zip(scene.train, fresh.train, strict=True):
        assert np.array_equal(view.load(), other.load())
    with pytest.raises(SceneError):  # a test view takes no memory before it is measured
        scene.test[0].load()


def test_it_says_how_many_are_decoded(tmp_path: Path):
    scene, heard = load_scene(write_blender(tmp_path)), []
    with heard_by(lambda *stage: heard.append(stage)):
        DecodeCheck(scene, seconds=60.0)
    count = len(scene.train) + len(scene.test)
    assert heard == [("decoding photographs", done, count) for done in range(count + 1)]
