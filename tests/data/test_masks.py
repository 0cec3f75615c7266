"""Masks in files of their own: found by name, the photograph's alpha, and said; unusable ones are one sentence."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scene_folders import (
    HEIGHT,
    WIDTH,
    colmap_names,
    nerfstudio_document,
    write_blender,
    write_colmap,
    write_image,
    write_mask,
    write_nerfstudio,
)

from ringlight.core.scene import Scene
from ringlight.data.hull import masks_of
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, SceneError
from ringlight.methods.recipe import recipe_from_dict

MIDDLE = np.zeros((HEIGHT, WIDTH), np.uint8)
MIDDLE[HEIGHT // 4 : -(HEIGHT // 4), WIDTH // 4 : -(WIDTH // 4)] = 255


def masked_colmap(folder: Path, called: Callable[[str], str] = "{}.png".format, **mask: object) -> Path:
    write_colmap(folder)
    for name in colmap_names(9):
        write_mask(folder / "masks" / called(name), **mask)  # type: ignore[arg-type]
    return folder


def views(scene: Scene) -> tuple:
    return (*scene.train, *scene.test)


def assert_masked(scene: Scene, alpha: np.ndarray = MIDDLE) -> None:
    assert all(view.has_alpha for view in views(scene))
    for view in views(scene):
        assert np.array_equal(view.load()[..., 3], alpha)
    assert scene.background == "white"


@pytest.mark.parametrize(
    "called",
    ["{}.png".format, lambda name: name, lambda name: name.removesuffix(".png") + ".jpg"],
    ids=["COLMAP", "the same name", "another suffix"],
)
def test_a_masks_folder_is_used_and_said(tmp_path: Path, called: Callable[[str], str]):
    scene = load_scene(masked_colmap(tmp_path, called))
    if called("a.png") != "a.jpg":
        assert_masked(scene)
    assert "masks: masks/ (9 of 9 photographs)" in scene.notes
    assert not any(note.startswith("warning") for note in scene.notes)
    assert len(masks_of(scene.train)) == 7, "the visual hull takes them"


def test_what_a_mask_drops_is_background_in_training_and_test_views(tmp_path: Path):
    plain = load_scene(write_colmap(tmp_path / "plain"))
    for asked, color in (("auto", 1.0), ("black", 0.0)):
        scene = load_scene(masked_colmap(tmp_path / asked), SceneOptions(background=asked))  # type: ignore[arg-type]
        for view, bare in zip(views(scene), views(plain), strict=True):
            picture, photograph = view.image(scene.background_color), bare.image(scene.background_color)
            kept = torch.from_numpy(MIDDLE) == 255
            assert torch.equal(picture[:, kept], photograph[:, kept])
            assert (picture[:, ~kept] == color).all()


@pytest.mark.parametrize("options", [SceneOptions(), SceneOptions(downscale=3)])
def test_a_mask_is_as_good_as_transparency(tmp_path: Path, options: SceneOptions):
    transparent, cut = write_blender(tmp_path / "rgba"), write_blender(tmp_path / "rgb")
    for path in sorted(cut.glob("t*/*.png")):
        pixels = np.array(Image.open(path))
        Image.fromarray(pixels[..., :3]).save(path)
        (cut / "masks" / path.parent.name).mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels[..., 3]).save(cut / "masks" / path.parent.name / f"{path.name}.png")
    for view, other in zip(views(load_scene(transparent, options)), views(load_scene(cut, options)), strict=True):
        assert np.array_equal(view.load(), other.load())


def test_masks_are_shrunk_with_their_photographs(tmp_path: Path):
    view = load_scene(masked_colmap(tmp_path), SceneOptions(downscale=2)).train[0]
    pixels = view.load()
    assert pixels.shape == (HEIGHT // 2, WIDTH // 2, 4)
    assert pixels[HEIGHT // 4, WIDTH // 4, 3] == 255
    assert pixels[0, 0, 3] == 0


def test_a_mask_may_be_a_rescaled_form_of_its_photograph_and_nothing_else(tmp_path: Path):
    halved = load_scene(masked_colmap(tmp_path / "halved", size=(WIDTH // 2, HEIGHT // 2)))
    assert halved.train[0].load()[HEIGHT // 2, WIDTH // 2, 3] == 255
    assert halved.train[0].load()[0, 0, 3] == 0
    masked_colmap(tmp_path / "other")
    write_mask(tmp_path / "other" / "masks" / f"{colmap_names(9)[3]}.png", (WIDTH, HEIGHT - 3))
    with pytest.raises(SceneError, match=r"masks/.*png: the mask has 16x9 pixels and its photograph .* 16x12;.*none"):
        load_scene(tmp_path / "other")


def test_nerfstudio_names_masks_in_its_frames(tmp_path: Path):
    document = nerfstudio_document()
    for index, frame in enumerate(document["frames"]):
        frame["mask_path"] = f"keep/{index}.png"
        write_mask(tmp_path / "keep" / f"{index}.png")
    scene = load_scene(write_nerfstudio(tmp_path, document))
    assert_masked(scene)
    assert "masks: mask_path (9 of 9 photographs)" in scene.notes
    (tmp_path / "keep" / "4.png").unlink()
    with pytest.raises(SceneError, match=r"the mask 'keep/4\.png' of images/0004\.png is missing; copy .*--masks none"):
        load_scene(tmp_path)
    assert not load_scene(tmp_path, SceneOptions(masks="none")).train[0].has_alpha


def test_a_frame_whose_mask_path_is_null_has_no_mask(tmp_path: Path):
    document = nerfstudio_document()
    document["mask_path"] = "keep.png"
    write_mask(tmp_path / "keep.png")
    document["frames"][2]["mask_path"] = None
    scene = load_scene(write_nerfstudio(tmp_path, document))
    note = "warning: masks: mask_path (8 of 9 photographs); the others, as images/0002.png, count as all subject"
    assert note in scene.notes
    opaque = [view.name for view in views(scene) if (view.load()[..., 3] == 255).all()]
    assert opaque == ["images/0002.png"]
    for frame in document["frames"]:
        frame["mask_path"] = None
    bare = load_scene(write_nerfstudio(tmp_path, document))
    assert not bare.train[0].has_alpha
    assert not any("masks" in note for note in bare.notes if not note.startswith("initial points"))


def test_a_mask_outside_the_folder_is_refused(tmp_path: Path):
    document = nerfstudio_document()
    write_mask(tmp_path / "secret.png")
    document["frames"][2]["mask_path"] = "../secret.png"
    with pytest.raises(SceneError, match=r"frame 2 .*outside"):
        load_scene(write_nerfstudio(tmp_path / "scene", document))


@pytest.mark.parametrize("name", ["../secret.png", "dangling.png", "a\0b", "x" * 300, "missing.png"])
def test_masks_of_the_scene_that_cannot_be_do_no_harm_where_others_or_none_are_wanted(tmp_path: Path, name: str):
    document, folder = nerfstudio_document(), tmp_path / "scene"
    document["frames"][2]["mask_path"] = name
    write_nerfstudio(folder, document)
    (folder / "dangling.png").symlink_to("gone.png")
    for index in range(9):
        write_mask(folder / "own" / f"{index:04d}.png")
    with pytest.raises(SceneError, match=r"images/0002\.png"):
        load_scene(folder)
    bare = load_scene(folder, SceneOptions(masks="none"))
    assert not bare.train[0].has_alpha
    assert "masks: those of the scene are not used, as --masks none asks" in bare.notes
    assert_masked(load_scene(folder, SceneOptions(masks="own")))


@pytest.mark.parametrize("inside", [True, False])
def test_any_scene_takes_a_folder_of_masks(tmp_path: Path, inside: bool, monkeypatch: pytest.MonkeyPatch):
    scene = write_blender(tmp_path / "scene", mode="RGB")
    for split, count in (("train", 4), ("test", 2)):
        for index in range(count):
            write_mask((scene if inside else tmp_path) / "cut" / split / f"r_{index}.png")
    monkeypatch.chdir(tmp_path)
    assert_masked(load_scene("scene", SceneOptions(masks="cut")))
    assert load_scene("scene").background == "photograph"


def test_masks_of_images_in_one_folder_need_not_repeat_it(tmp_path: Path):
    folder = write_nerfstudio(tmp_path)
    for index in range(9):
        write_mask(folder / "masks" / f"{index:04d}.png")
    assert_masked(load_scene(folder))


def test_masks_that_are_not_used_are_said(tmp_path: Path):
    scene = load_scene(masked_colmap(tmp_path), SceneOptions(masks="none"))
    assert not scene.train[0].has_alpha
    assert any("masks" in note and "not used" in note for note in scene.notes)
    for path in (tmp_path / "masks").rglob("*.png"):
        path.rename(path.with_name(f"other-{path.name}"))
    scene = load_scene(tmp_path)
    assert any(note.startswith("warning: masks: none in masks/ is called like a photograph") for note in scene.notes)
    with pytest.raises(SceneError, match="holds no mask that is called like a photograph"):
        load_scene(tmp_path, SceneOptions(masks="masks"))
    with pytest.raises(SceneError, match="nowhere: no such folder"):
        load_scene(tmp_path, SceneOptions(masks="nowhere"))
    assert not any("masks" in note for note in load_scene(write_colmap(tmp_path / "bare")).notes)


def test_photographs_without_a_mask_are_counted_and_all_subject(tmp_path: Path):
    masked_colmap(tmp_path)
    for name in colmap_names(9)[2:5]:
        (tmp_path / "masks" / f"{name}.png").unlink()
    scene = load_scene(tmp_path)
    [note] = [note for note in scene.notes if "masks/" in note]
    assert note.startswith("warning: masks: masks/ (6 of 9 photographs); the others")
    bare = [view for view in views(scene) if view.name in colmap_names(9)[2:5]]
    assert all((view.load()[..., 3] == 255).all() for view in bare)
    assert len(masks_of(scene.train)) == 7


def test_inverted_masks_are_noticed_and_can_be_turned(tmp_path: Path):
    masked_colmap(tmp_path, kept=False)
    warned = load_scene(tmp_path)
    assert any("9 of 9 looked at" in note and note.endswith("give --invert-masks") for note in warned.notes)
    turned = load_scene(tmp_path, SceneOptions(invert_masks=True))
    assert_masked(turned)
    assert "masks: masks/ (9 of 9 photographs, inverted)" in turned.notes
    wrongly = load_scene(masked_colmap(tmp_path / "right"), SceneOptions(invert_masks=True))
    assert any(note.endswith("leave --invert-masks out") for note in wrongly.notes)
    with pytest.raises(SceneError, match="no masks that --invert-masks could invert"):
        load_scene(write_colmap(tmp_path / "bare"), SceneOptions(invert_masks=True))
    with pytest.raises(RecipeError, match="--invert-masks and --masks none"):
        SceneOptions(invert_masks=True, masks="none")


def test_masks_of_what_disturbs_are_noticed(tmp_path: Path):
    folder = write_colmap(tmp_path)
    for name in colmap_names(9):
        pixels = np.full((HEIGHT, WIDTH), 255, np.uint8)
        pixels[HEIGHT - 4 :, :4] = 0  # somebody's feet in a corner
        path = folder / "masks" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(path)
    [note] = [note for note in load_scene(folder).notes if "borders" in note]
    assert note.startswith("masks keep the borders")
    assert note.endswith("if it only disturbs, give --masks none")


def test_masks_that_keep_nothing_are_one_sentence(tmp_path: Path):
    masked_colmap(tmp_path, value=0)
    with pytest.raises(SceneError, match=r"the masks keep nothing.*black all over; make them white.*--masks none"):
        load_scene(tmp_path)
    for name in colmap_names(9)[1:]:
        write_mask(tmp_path / "masks" / f"{name}.png")
    assert any("the masks of 1 of 9 photographs looked at are black" in note for note in load_scene(tmp_path).notes)


def test_a_mask_may_be_of_labels_or_in_alpha_and_joins_the_photographs_own(tmp_path: Path):
    masked_colmap(tmp_path, value=1)
    first, second = (tmp_path / "masks" / f"{name}.png" for name in colmap_names(9)[:2])
    Image.fromarray(np.dstack([np.zeros((HEIGHT, WIDTH, 3), np.uint8), MIDDLE])).save(first)
    Image.fromarray(np.dstack([MIDDLE] * 3)).save(second)
    write_image(tmp_path / "images" / colmap_names(9)[2], mode="RGBA", seed=5)
    scene = load_scene(tmp_path)
    own = next(view for view in views(scene) if view.name == colmap_names(9)[2])
    drawn = np.array(Image.open(tmp_path / "images" / colmap_names(9)[2]))[..., 3]
    assert np.array_equal(own.load()[..., 3], np.minimum(drawn, MIDDLE))
    for view in views(scene):
        if view is not own:
            assert np.array_equal(view.load()[..., 3], MIDDLE)


def test_a_damaged_mask_is_named(tmp_path: Path):
    path = masked_colmap(tmp_path) / "masks" / f"{colmap_names(9)[4]}.png"
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(SceneError, match=r"masks/.*\.png: not a readable image"):
        [view.load() for view in views(load_scene(tmp_path))]


@pytest.mark.parametrize("name", [7, "", "a\0b"])
def test_a_mask_path_that_is_no_name_is_refused(tmp_path: Path, name: object):
    document = nerfstudio_document()
    document["frames"][1]["mask_path"] = name
    write_nerfstudio(tmp_path, document)
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(SceneError, match="frame 1"):
        load_scene(tmp_path)


def test_a_run_that_knew_no_masks_goes_on_without(tmp_path: Path):
    """It saw whole photographs, whatever lies beside them."""
    folder = masked_colmap(tmp_path)
    asked = dataclasses.asdict(SceneOptions())
    written_before = {name: value for name, value in asked.items() if name not in ("masks", "invert_masks")}
    scene = load_scene(folder, recipe_from_dict(SceneOptions, written_before))
    assert scene.background == "photograph"
    assert all(view.load().shape[2] == 3 for view in views(scene))
    assert_masked(load_scene(folder, recipe_from_dict(SceneOptions, asked)))


def test_photographs_are_no_masks_of_their_own(tmp_path: Path):
    """``--masks "$MASKS"`` with nothing in that variable names the scene's folder."""
    write_nerfstudio(tmp_path)
    with pytest.raises(SceneError, match=r"images/000\d\.png would be its own mask"):
        load_scene(tmp_path, SceneOptions(masks=""))
