"""Which photographs train and which test, and what is said where the two are mixed up."""

import shutil
from pathlib import Path

import pytest
from scene_folders import (
    blender_document,
    colmap_names,
    nerfstudio_document,
    write_blender,
    write_colmap,
    write_image,
    write_nerfstudio,
)

from ringlight.core.scene import View
from ringlight.data.load import kept_options, load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, SceneError

WRITERS = {"blender": write_blender, "colmap": write_colmap, "nerfstudio": write_nerfstudio}
ALL_OF_THEM = SceneOptions(holdout_every=0)


def names(views: tuple[View, ...]) -> list[str]:
    return [view.name for view in views]


@pytest.mark.parametrize("format", WRITERS)
def test_all_photographs_can_be_for_training(tmp_path: Path, format: str):
    folder = WRITERS[format](tmp_path)
    split, whole = load_scene(folder), load_scene(folder, ALL_OF_THEM)
    assert names(whole.train) == sorted(names((*split.train, *split.test)))
    assert whole.test == ()
    assert any("all photographs are for training" in note for note in whole.notes)


def test_one_photograph_is_enough_to_train_on(tmp_path: Path):
    write_nerfstudio(tmp_path, nerfstudio_document(1), count=1)
    with pytest.raises(SceneError, match=r"1 image is too few .*--holdout-every 0"):
        load_scene(tmp_path)
    assert len(load_scene(tmp_path, ALL_OF_THEM).train) == 1


def test_holding_out_every_photograph_is_refused():
    with pytest.raises(RecipeError, match="--holdout-every is 1: no image would be left for training; give 2 or more"):
        SceneOptions(holdout_every=1)


@pytest.mark.parametrize("format", WRITERS)
def test_test_images_can_be_named(tmp_path: Path, format: str):
    folder = WRITERS[format](tmp_path)
    everything = names(load_scene(folder, ALL_OF_THEM).train)
    chosen = [everything[4], everything[1]]
    (tmp_path / "list.txt").write_text("\ufeff" + "\r\n".join([*chosen, "", ""]), encoding="utf-8")
    for holdout in (", ".join(chosen), str(tmp_path / "list.txt")):
        scene = load_scene(folder, SceneOptions(holdout=holdout))
        assert names(scene.test) == sorted(chosen)
        assert names(scene.train) == [name for name in everything if name not in chosen]
        assert "split: --holdout names 2 test images" in scene.notes


def test_a_name_may_lack_its_folder_if_it_is_the_only_one(tmp_path: Path):
    folder = write_colmap(tmp_path / "one")
    assert names(load_scene(folder, SceneOptions(holdout="003.png")).test) == ["left/003.png"]
    with pytest.raises(
        SceneError, match=r"--holdout names 'r_1\.png', which may be test/r_1\.png and train/r_1\.png; give the folder"
    ):
        load_scene(write_blender(tmp_path / "two"), SceneOptions(holdout="r_1.png"))


@pytest.mark.parametrize(
    ("holdout", "reason"),
    [("absent.png", "'absent.png', which is none of the images of "), (" , ", "names no image"), ("no.txt", "no.txt")],
)
def test_a_list_that_names_nothing_is_refused(tmp_path: Path, holdout: str, reason: str):
    with pytest.raises(SceneError, match=reason):
        load_scene(write_colmap(tmp_path), SceneOptions(holdout=holdout))


@pytest.mark.parametrize("content", [b"\xff\xfe\x80", b"", b"\n\n"])
def test_a_list_that_is_none_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "list.txt").write_bytes(content)
    with pytest.raises(SceneError, match=r"list\.txt"):
        load_scene(write_colmap(tmp_path), SceneOptions(holdout=str(tmp_path / "list.txt")))


def test_naming_all_photographs_leaves_none_to_train_on(tmp_path: Path):
    with pytest.raises(SceneError, match="no training image"):
        load_scene(write_colmap(tmp_path), SceneOptions(holdout=",".join(colmap_names(9))))


def test_an_empty_list_of_test_images_means_none(tmp_path: Path):
    document = nerfstudio_document() | {"test_filenames": []}
    scene = load_scene(write_nerfstudio(tmp_path, document))
    assert (len(scene.train), len(scene.test)) == (9, 0)
    assert any("empty: there are no test views" in note for note in scene.notes)


def test_what_a_run_keeps_does_not_change_with_lists_and_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = write_colmap(tmp_path / "scene")
    (tmp_path / "cut").mkdir()
    (tmp_path / "list.txt").write_text("left/001.png\n")
    monkeypatch.chdir(tmp_path)
    kept = kept_options(folder, SceneOptions(holdout="list.txt", masks="cut"))
    (tmp_path / "list.txt").unlink()
    assert names(load_scene(folder, SceneOptions(holdout=kept.holdout)).test) == ["left/001.png"]
    assert kept.masks == str(tmp_path / "cut")
    assert kept_options(folder, kept) == kept
    assert kept_options(folder, SceneOptions()) == SceneOptions()
    assert kept_options(folder, SceneOptions(masks="images")).masks == "images", "moves with the scene"


def warnings(folder: Path, options: SceneOptions | None = None) -> list[str]:
    return [note for note in load_scene(folder, options).notes if note.startswith("warning")]


def test_views_that_train_and_test_are_said(tmp_path: Path):
    listed = [f"images/{index:04d}.png" for index in range(9)]
    document = nerfstudio_document() | {"train_filenames": listed[:6], "test_filenames": listed[4:]}
    [note] = warnings(write_nerfstudio(tmp_path, document))
    assert "2 photographs (images/0004.png, images/0005.png) are used for training and for testing" in note


def test_frames_that_are_listed_twice_are_said(tmp_path: Path):
    document = nerfstudio_document()
    document["frames"].append(document["frames"][3])
    [note] = warnings(write_nerfstudio(tmp_path, document))
    assert note == "warning: images/0003.png is listed more than once and used once"


def test_lists_that_name_a_frame_twice_are_said(tmp_path: Path):
    listed = [f"images/{index:04d}.png" for index in range(9)]
    document = nerfstudio_document() | {"train_filenames": listed[:7], "test_filenames": [listed[7], listed[7]]}
    assert warnings(write_nerfstudio(tmp_path, document)) == ["warning: images/0007.png is a test view more than once"]


def test_a_rule_that_counts_for_nothing_is_said(tmp_path: Path):
    options = SceneOptions(holdout_every=5)
    assert any("--holdout-every 5 has no effect" in note for note in warnings(write_blender(tmp_path / "a"), options))
    folder = write_colmap(tmp_path / "b")
    assert warnings(folder, options) == []
    named = SceneOptions(holdout_every=5, holdout="003.png")
    assert warnings(folder, named) == ["warning: --holdout-every 5 has no effect: the split is another"]


def test_copies_of_training_views_are_said(tmp_path: Path):
    folder = write_blender(tmp_path)
    assert warnings(folder) == [
        "warning: the test view test/r_0.png has the bytes of the training view train/r_0.png, and 1 more"
    ]
    write_image(folder / "test" / "r_0.png", mode="RGBA", seed=50)
    shutil.copy(folder / "train" / "r_2.png", folder / "test" / "r_1.png")
    [note] = warnings(folder)
    assert "test/r_1.png has the bytes of the training view train/r_2.png" in note
    write_image(folder / "test" / "r_1.png", mode="RGBA", seed=51)
    assert warnings(folder) == []
    assert blender_document("test", 2)["frames"], "the lists are as they were"


def test_a_scene_without_test_views_can_be_validated_on_training_views(tmp_path: Path):
    scene = load_scene(write_colmap(tmp_path), SceneOptions(holdout_every=0, validate=True))
    assert (len(scene.train), len(scene.test)) == (8, 1)
