"""NeRF-Synthetic folders: axes, splits, and what may be wrong with them."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from scene_folders import HEIGHT, WIDTH, blender_document, look_at_origin, write_blender, write_image

from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import SceneError


def rewrite(folder: Path, split: str = "train", **changes: object) -> None:
    file = folder / f"transforms_{split}.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def with_pose(matrix: object) -> dict:
    document = blender_document("train", 4)
    document["frames"][2]["transform_matrix"] = matrix
    return document


def test_cameras_look_along_minus_z_of_the_file(tmp_path: Path):
    scene = load_scene(write_blender(tmp_path))
    for index, view in enumerate(scene.train):
        matrix = look_at_origin(index)
        assert torch.allclose(view.camera.position, torch.from_numpy(matrix[:3, 3]).float(), atol=1e-5)
        assert torch.allclose(view.camera.forward, -torch.from_numpy(matrix[:3, 2]).float(), atol=1e-5)
        down = view.camera.world_to_camera[1, :3]
        assert torch.allclose(down, -torch.from_numpy(matrix[:3, 1]).float(), atol=1e-5)
        # The origin is in the middle of the picture.
        assert torch.allclose(view.camera.world_to_camera[:2, 3], torch.zeros(2), atol=1e-5)


def test_the_angle_is_horizontal_and_pixels_are_square(tmp_path: Path):
    camera = load_scene(write_blender(tmp_path)).train[0].camera
    expected = 0.5 * WIDTH / np.tan(0.4)
    assert camera.focal == pytest.approx((expected, expected))
    assert camera.center == (WIDTH / 2, HEIGHT / 2)


def test_only_images_of_the_json_are_read(tmp_path: Path):
    write_blender(tmp_path)
    for name in ("r_0_normal.png", "r_0_alpha.png", "notes.txt"):
        (tmp_path / "test" / name).write_bytes(b"not an image")
    (tmp_path / "transforms_val.json").write_text("not JSON")
    scene = load_scene(tmp_path)
    assert [view.name for view in scene.test] == ["test/r_0.png", "test/r_1.png"]


def test_names_may_have_their_suffix_and_another_type(tmp_path: Path):
    write_blender(tmp_path)
    document = blender_document("train", 4)
    write_image(tmp_path / "train" / "photo.jpg")
    document["frames"][0]["file_path"] = "train/r_0.png"
    document["frames"][1]["file_path"] = "train\\photo"
    rewrite(tmp_path, **document)
    assert [view.name for view in load_scene(tmp_path).train][:2] == ["train/r_0.png", "train/photo.jpg"]


def test_without_a_test_file_every_eighth_is_held_out(tmp_path: Path):
    write_blender(tmp_path, train=10)
    (tmp_path / "transforms_test.json").unlink()
    scene = load_scene(tmp_path)
    assert [view.name for view in scene.test] == ["train/r_0.png", "train/r_8.png"]
    assert len(scene.train) == 8
    assert any("index % 8 == 0" in note for note in scene.notes)
    assert len(load_scene(tmp_path, SceneOptions(holdout_every=2)).test) == 5


def test_validation_measures_on_training_views_that_it_holds_out(tmp_path: Path):
    write_blender(tmp_path, train=12)
    everything = load_scene(tmp_path)
    scene = load_scene(tmp_path, SceneOptions(validate=True))
    assert [view.name for view in scene.test] == ["train/r_0.png", "train/r_10.png"]
    assert {view.name for view in scene.train + scene.test} == {view.name for view in everything.train}
    assert len(scene.train) == 10
    assert any(note.startswith("validation: ") for note in scene.notes)
    assert not any(note.startswith("validation: ") for note in everything.notes)


def test_a_single_training_view_cannot_be_held_out(tmp_path: Path):
    write_blender(tmp_path, train=1)
    with pytest.raises(SceneError, match="--validate"):
        load_scene(tmp_path, SceneOptions(validate=True))


@pytest.mark.parametrize(
    ("mode", "asked", "background"),
    [
        ("RGBA", "auto", "white"),
        ("RGB", "auto", "photograph"),
        ("RGBA", "black", "black"),
        ("RGBA", "random", "random"),
        ("RGB", "black", "black"),
    ],
)
def test_the_background_is_stated(tmp_path: Path, mode: str, asked: str, background: str):
    scene = load_scene(write_blender(tmp_path, mode=mode), SceneOptions(background=asked))
    assert scene.background == background
    assert f"background: {background}" in scene.notes
    assert scene.train[0].has_alpha == (mode == "RGBA")


def test_a_missing_image_is_named_with_its_frame_and_the_number_of_others(tmp_path: Path):
    write_blender(tmp_path)
    (tmp_path / "train" / "r_1.png").unlink()
    with pytest.raises(SceneError, match=r"train\.json: frame 1 .*'\./train/r_1'.*1 of 4 images missing\); copy"):
        load_scene(tmp_path)
    (tmp_path / "train" / "r_3.png").unlink()
    with pytest.raises(SceneError, match=r"frame 1 .*2 of 4 images missing"):
        load_scene(tmp_path)


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "train/../../secret", "..\\secret"])
def test_an_image_outside_the_folder_is_refused(tmp_path: Path, name: str):
    folder = write_blender(tmp_path / "scene")
    write_image(tmp_path / "secret.png")
    document = blender_document("train", 4)
    document["frames"][1]["file_path"] = name
    rewrite(folder, **document)
    with pytest.raises(SceneError, match=r"frame 1 .*outside"):
        load_scene(folder)


@pytest.mark.parametrize("place", ["train/r_1.png", "train"])
def test_photographs_may_be_links_out_of_the_folder(tmp_path: Path, place: str):
    """As in the caches of Hugging Face, git-annex and DVC, whose files have no suffix."""
    folder = write_blender(tmp_path / "scene")
    plain = load_scene(folder)
    pixels = [view.load() for view in plain.train]
    (folder / place).rename(tmp_path / "4f3a")
    (folder / place).symlink_to(tmp_path / "4f3a")
    scene = load_scene(folder)
    assert [view.name for view in scene.train] == [view.name for view in plain.train]
    assert all(np.array_equal(view.load(), before) for view, before in zip(scene.train, pixels, strict=True))


def test_a_name_that_leaves_the_folder_by_a_link_in_it_is_refused(tmp_path: Path):
    folder = write_blender(tmp_path / "scene")
    write_image(tmp_path / "other" / "secret.png")
    (tmp_path / "other" / "inside").mkdir()
    (folder / "link").symlink_to(tmp_path / "other" / "inside")
    document = blender_document("train", 4)
    document["frames"][1]["file_path"] = "link/../secret.png"
    rewrite(folder, **document)
    with pytest.raises(SceneError, match=r"'link/../secret\.png', which does not exist"):
        load_scene(folder)


def test_links_to_what_is_no_photograph_are_one_sentence(tmp_path: Path):
    folder = write_blender(tmp_path / "scene")
    link = folder / "train" / "r_1.png"
    link.unlink()
    (tmp_path / "text").write_text("secret words")
    os.mkfifo(tmp_path / "pipe")
    reasons = {
        "text": "not a readable image",
        "pipe": "does not exist",
        ".": "does not exist",
        "gone": "fetch it",
    }
    for target, reason in reasons.items():
        link.symlink_to(tmp_path / target)
        with pytest.raises(SceneError, match=rf"r_1.*{reason}") as caught:
            load_scene(folder)
        assert "secret words" not in str(caught.value)
        link.unlink()


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000, "\ud800", "loop", 7, "", None])
def test_names_that_no_file_can_have_are_refused(tmp_path: Path, name: object):
    folder = write_blender(tmp_path)
    (folder / "loop").symlink_to(folder / "loop")
    document = blender_document("train", 4)
    document["frames"][1]["file_path"] = name
    rewrite(folder, **document)
    with pytest.raises(SceneError, match="frame 1"):
        load_scene(folder)


SHEARED = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
MIRRORED = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
FAR = [[1, 0, 0, 1e30], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
PROJECTIVE = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 1, 0]]


@pytest.mark.parametrize(
    "matrix",
    [
        SHEARED, MIRRORED, FAR, PROJECTIVE, [[0.0] * 4] * 4, [[float("nan")] * 4] * 4, [[float("inf")] * 4] * 4,
        [[1, 2, 3, 4]], [[1, 2, 3]] * 4, "identity", None, [[10**400] * 4] * 4, [["1"] * 4] * 4, [[True] * 4] * 4,
    ],
)  # fmt: skip
def test_a_pose_that_is_no_rigid_motion_is_refused_with_its_frame(tmp_path: Path, matrix: object):
    folder = write_blender(tmp_path)
    rewrite(folder, **with_pose(matrix))
    with pytest.raises(SceneError, match=r"frame 2 \('\./train/r_2'\)"):
        load_scene(folder)


def test_scale_and_rounding_in_a_pose_do_no_harm(tmp_path: Path):
    folder = write_blender(tmp_path)
    exact = load_scene(folder).train[2].camera.world_to_camera
    matrix = look_at_origin(2)
    matrix[:3, :3] *= 2.5
    rewrite(folder, **with_pose(matrix[:3].tolist()))
    assert torch.allclose(load_scene(folder).train[2].camera.world_to_camera, exact, atol=1e-5)
    rewrite(folder, **with_pose(look_at_origin(2).round(3).tolist()))
    rounded = load_scene(folder).train[2].camera.world_to_camera
    assert torch.allclose(rounded[:3, :3] @ rounded[:3, :3].T, torch.eye(3), atol=1e-6)


@pytest.mark.parametrize("split", ["train", "test"])
@pytest.mark.parametrize("document", [{"frames": []}, {"frames": {}}, {"frames": None}])
def test_a_file_without_frames_is_refused(tmp_path: Path, split: str, document: dict):
    folder = write_blender(tmp_path)
    rewrite(folder, split, **document)
    with pytest.raises(SceneError, match=rf"transforms_{split}\.json: lists no frames"):
        load_scene(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "[" * 100_000, '{"frames": [1]}', b"\xff\xfe\x00", b"\x89PNG"])
def test_json_that_is_none_or_another_kind_is_refused(tmp_path: Path, text: str | bytes):
    folder = write_blender(tmp_path)
    (folder / "transforms_train.json").write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(SceneError, match=r"transforms_train\.json"):
        load_scene(folder)


@pytest.mark.parametrize("angle", [0, -1, 3.2, 1e-300, "wide", float("nan"), None])
def test_an_impossible_field_of_view_is_refused(tmp_path: Path, angle: object):
    folder = write_blender(tmp_path)
    rewrite(folder, camera_angle_x=angle)
    with pytest.raises(SceneError, match="frame 0"):
        load_scene(folder)


@pytest.mark.parametrize("frames", [[], {}, None])
def test_no_test_images_are_listed_where_all_are_for_training(frames: object, tmp_path: Path):
    rewrite(write_blender(tmp_path), "test", frames=frames)
    all_of_them = SceneOptions(holdout_every=0)
    if frames == []:
        scene = load_scene(tmp_path, all_of_them)
        assert scene.train
        assert not scene.test
    else:
        with pytest.raises(SceneError, match=r"transforms_test\.json: lists no frames"):
            load_scene(tmp_path, all_of_them)
    rewrite(tmp_path, "train", frames=[])
    with pytest.raises(SceneError, match=r"transforms_train\.json: lists no frames"):
        load_scene(tmp_path, all_of_them)
