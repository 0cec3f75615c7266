"""Remedies that did not help."""

import shutil

import numpy as np
from deep_png import deep_png
from PIL import Image
from safetensors import safe_open
from safetensors.torch import save_file
from scene_folders import colmap_names, nerfstudio_document, write_nerfstudio, write_photographs
from scenes_on_disk import edit_json
from tried import QUICK, Outcome, Tried, finding

HERE = "cli/test_first_hour.py"


@finding("L7a", "remedies fit: too many points", f"{HERE}::test_remedies_fit_what_went_wrong")
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), "--initial-points", "1000000000000", "--quiet")
    return "--initial-points" in done.err and "downscale" not in done.err, done.last


@finding("L7b", "a full disk behind a table", f"{HERE}::test_a_full_disk_behind_standard_output_has_its_own_remedy")
def _(it: Tried) -> Outcome:
    return it("info", it.trained(), script='"$@" > /dev/full').refuses("standard output")


@finding("L7c", "a cache that cannot be", f"{HERE}::test_remedies_fit_what_went_wrong")
def _(it: Tried) -> Outcome:
    (it.folder / "file").write_text("no folder")
    return it("fetch-lpips", RINGLIGHT_CACHE=str(it.folder / "file" / "cache")).refuses("RINGLIGHT_CACHE")


@finding(
    "L7d", "a photograph too large", "data/test_image_formats.py::test_an_image_of_too_many_pixels_has_its_own_remedy"
)
def _(it: Tried) -> Outcome:
    scene = write_nerfstudio(it.folder / "scene")
    Image.new("L", (20_000, 20_000)).save(scene / "images" / "0003.png")
    return it.train(scene, "--quiet").refuses("million")


@finding("L7e", "16-bit photographs", "data/test_image_formats.py::test_sixteen_bits_are_rounded_not_cut")
def _(it: Tried) -> Outcome:
    scene = write_nerfstudio(it.folder / "scene")
    (scene / "images" / "0003.png").write_bytes(deep_png(np.full((12, 16, 1), 40_000, np.uint16)))
    return it.train(scene).says("16 bits a channel")


@finding("L7f", "--zoom inf", f"{HERE}::test_remedies_fit_what_went_wrong")
def _(it: Tried) -> Outcome:
    return it("render", it.trained(), "--zoom", "inf", "--quiet").refuses("finite number")


@finding(
    "L7g",
    "a picture too wide",
    "core/test_camera.py::test_more_pixels_than_kernels_draw_are_refused_by_the_flags_that_help",
)
def _(it: Tried) -> Outcome:
    wide = nerfstudio_document() | {"w": 8200, "h": 12, "cx": 4100.0}
    scene = write_nerfstudio(it.folder / "scene", wide)
    write_photographs(it.folder / "wide", size=(8200, 12))
    for index, name in enumerate(colmap_names(9)):
        (it.folder / "wide" / name).replace(scene / "images" / f"{index:04d}.png")
    return it.train(scene, "--max-width", "9000", "--quiet").refuses("--downscale")


@finding(
    "L7h",
    "a scene that moved",
    "cli/test_bad_input.py::test_a_scene_that_has_moved_may_be_named_by_every_command_that_takes_it",
)
def _(it: Tried) -> Outcome:
    edit_json(it.trained() / "recipe.json", lambda record: record.update(scene=str(it.folder / "gone")))
    return it("render", it.folder / "run", "--quiet").refuses("--scene")


@finding("L7i", "another run's checkpoint", f"{HERE}::test_a_checkpoint_of_another_run_is_called_so")
def _(it: Tried) -> Outcome:
    it("train", it.balls(), "3dgs", *QUICK, "--sh-degree", "1", "--quiet", "--out", it.folder / "other")
    shutil.copy(it.folder / "other" / "checkpoint.safetensors", it.trained() / "checkpoint.safetensors")
    return it("train", "--resume", it.folder / "run", "--quiet").refuses("another run's")


@finding(
    "L7j",
    "huge numbers of a stranger",
    f"{HERE}::test_a_strangers_model_of_huge_numbers_is_not_to_be_trained_otherwise",
)
def _(it: Tried) -> Outcome:
    model = it.trained() / "model.safetensors"
    with safe_open(model, framework="pt") as file:
        tensors, facts = {name: file.get_tensor(name) for name in file.keys()}, file.metadata()  # noqa: SIM118
    tensors["columns.means"].fill_(3e38)
    for name in ("checksum", "ringlight.checksum"):
        facts.pop(name, None)
    save_file(tensors, model, metadata=facts)
    return it("render", model, "--path", "train", "--quiet", "--out", it.folder / "out").omits("learn at lower rates")
