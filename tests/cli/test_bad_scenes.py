"""Photographs and cameras that cannot be used: one sentence, and no run folder is made.

Damage at every byte of COLMAP files is tested beside their reader.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from command import Command
from refusal import QUIET, SHORT, Damage, refused, snapshot
from scenes_on_disk import edit_json

from data.scene_folders import write_colmap
from ringlight.data.decode_check import DecodeCheck


def _missing_image(scene: Path) -> None:
    (scene / "train" / "r_1.png").unlink()


def _not_an_image(scene: Path) -> None:
    (scene / "train" / "r_1.png").write_text("not a picture")


def _no_frames(scene: Path) -> None:
    edit_json(scene / "transforms_train.json", lambda document: document.pop("frames"))


def _zero_frames(scene: Path) -> None:
    edit_json(scene / "transforms_train.json", lambda document: document.update(frames=[]))


def _zero_test_frames(scene: Path) -> None:
    edit_json(scene / "transforms_test.json", lambda document: document.update(frames=[]))


def _not_json(scene: Path) -> None:
    (scene / "transforms_train.json").write_text("{")


def _outside(scene: Path) -> None:
    shutil.copy(scene / "train" / "r_0.png", scene.parent / "secret.png")
    edit_json(scene / "transforms_train.json", lambda document: document["frames"][0].update(file_path="../secret.png"))


def _infinite_pose(scene: Path) -> None:
    def change(document: dict) -> None:
        document["frames"][2]["transform_matrix"][0][3] = float("inf")

    edit_json(scene / "transforms_train.json", change)


def _unsupported_camera(scene: Path) -> None:
    document = json.loads((scene / "transforms_train.json").read_text())
    for split in ("train", "test"):
        (scene / f"transforms_{split}.json").unlink()
    document |= {"camera_model": "EQUIRECTANGULAR", "fl_x": 20.0, "fl_y": 20.0, "w": 20, "h": 20}
    (scene / "transforms.json").write_text(json.dumps(document))


DAMAGED_SCENES: dict[str, tuple[Damage, str]] = {
    "a frame whose image is missing": (_missing_image, "r_1"),
    "a file that is no image": (_not_an_image, "r_1.png"),
    "JSON without frames": (_no_frames, "transforms_train.json"),
    "JSON with zero frames": (_zero_frames, "transforms_train.json"),
    "zero images in the test split": (_zero_test_frames, "transforms_test.json"),
    "broken JSON": (_not_json, "transforms_train.json"),
    "an image outside the scene folder": (_outside, "secret.png"),
    "a non-finite pose": (_infinite_pose, "transforms_train.json"),
    "an unsupported camera model": (_unsupported_camera, "EQUIRECTANGULAR"),
}


@pytest.mark.parametrize("name", DAMAGED_SCENES)
def test_a_damaged_scene_is_refused_before_a_folder_is_made(
    name: str, scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    damage, place = DAMAGED_SCENES[name]
    damage(scene_copy)
    before = snapshot(scene_copy)
    out = tmp_path / "out"
    refused(ringlight("train", scene_copy, "3dgs", "--out", out, "--steps", "8", *QUIET), 1, place)
    assert snapshot(scene_copy) == before
    assert not out.exists()


@pytest.mark.parametrize("split", ["train", "test"])
def test_a_truncated_image_is_found_before_a_folder_is_made(
    split: str, scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    image = scene_copy / split / "r_1.png"
    image.write_bytes(image.read_bytes()[:150])
    refused(ringlight("train", scene_copy, "3dgs", "--out", tmp_path / "out", "--steps", "8", *QUIET), 1, image)
    assert not (tmp_path / "out").exists()


def test_a_truncated_image_of_many_ends_training_where_it_can_go_on(
    scene_copy: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = DecodeCheck.__init__
    monkeypatch.setattr(DecodeCheck, "__init__", lambda self, scene: check(self, scene, seconds=0.0))
    monkeypatch.setattr(DecodeCheck, "refuse_damaged", _once_the_folder_is_there(tmp_path / "out"))
    image = scene_copy / "test" / "r_1.png"
    whole = image.read_bytes()
    image.write_bytes(whole[:150])
    out = ("--out", tmp_path / "out")
    sentence = refused(ringlight("train", scene_copy, "3dgs", *out, *SHORT), 1, image, f"--resume {tmp_path / 'out'}")
    assert "step 0" in sentence
    image.write_bytes(whole)
    assert ringlight("train", "--resume", tmp_path / "out", *QUIET).code == 0
    assert (tmp_path / "out" / "report.json").is_file()


def _once_the_folder_is_there(out: Path) -> Callable[[DecodeCheck], None]:
    """As where decoding takes longer than everything before the first step."""
    refuse = DecodeCheck.refuse_damaged

    def late(check: DecodeCheck) -> None:
        if out.exists():
            check.wait()
            refuse(check)

    return late


def test_a_truncated_test_image_ends_the_evaluation(run_folder: Path, scene_copy: Path, ringlight: Command) -> None:
    image = scene_copy / "test" / "r_1.png"
    image.write_bytes(image.read_bytes()[:150])
    before = snapshot(run_folder)
    refused(ringlight("eval", run_folder, scene_copy, "--quiet", "--lpips"), 1, image)
    assert snapshot(run_folder) == before


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_colmap_file_that_is_cut(file: str, share: float, tmp_path: Path, ringlight: Command) -> None:
    scene = write_colmap(tmp_path / "scene")
    model = scene / "sparse" / "0"
    content = (model / file).read_bytes()
    (model / file).write_bytes(content[: int(share * len(content))])
    refused(ringlight("train", scene, "3dgs", "--out", tmp_path / "out", *QUIET), 1, model / file)
    assert not (tmp_path / "out").exists()


def test_a_lens_that_cannot_be_undistorted_is_refused_with_the_remedy(tmp_path: Path, ringlight: Command) -> None:
    scene = write_colmap(tmp_path / "scene", camera=("FOV", 7, (20.0, 20.0, 8.0, 6.0, 0.5)))
    refused(ringlight("train", scene, "3dgs", "--out", tmp_path / "out", *QUIET), 1, "FOV", "undistort")
