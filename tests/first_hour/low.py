"""What irritated: silences, words, what was not said."""

import json
import re
import shlex
import shutil
import signal

from scene_folders import (
    FOCAL,
    nerfstudio_document,
    write_colmap,
    write_colmap_binary,
    write_nerfstudio,
)
from tried import Outcome, Tried, finding

HERE = "cli/test_first_hour.py"


@finding("L1a", "export looks for its folder first", f"{HERE}::test_an_export_looks_for_its_folder_first")
def _(it: Tried) -> Outcome:
    (it.trained() / "model.safetensors").write_bytes(b"damaged, which is found where it is read")
    return it("export", it.folder / "run", it.folder / "none" / "x.ply").refuses("folder does not exist")


@finding("L1b", "export says how far it is", "cli/test_stages.py::test_every_verb_that_takes_long_says_how_far_it_is")
def _(it: Tried) -> Outcome:
    return it("export", it.trained(), it.folder / "x.ply").says("reading")


@finding("L2a", "commands to copy are quoted", f"{HERE}::test_commands_to_copy_are_quoted")
def _(it: Tried) -> Outcome:
    run = it.folder / "my run; ü"
    shown = it.train(it.balls(), "--out", run).err.rpartition("see it with: ")[2].strip()
    return shlex.split(shown) == ["ringlight", "render", str(run)], shown


@finding("L2b", "COLMAP's too", "data/test_colmap.py::test_the_command_that_undistorts_is_quoted")
def _(it: Tried) -> Outcome:
    scene = write_colmap(it.folder / "lens space", camera=("FOV", 7, (FOCAL, FOCAL, 8.0, 6.0, 0.5)))
    words = shlex.split(it.train(scene, "--quiet").err.partition("undistort with: ")[2])
    return str(scene / "images") in words, " ".join(words[:5])


@finding("L3a", "--quiet keeps warnings", "cli/test_stages.py::test_warnings_of_a_scene_are_no_progress")
def _(it: Tried) -> Outcome:
    scene = write_colmap(it.folder / "scene")
    write_colmap_binary(scene / "sparse" / "1", count=4)
    return it.train(scene, "--quiet").says("2 models")


@finding("L3b", "flags without effect are refused", "cli/test_bad_input.py::test_wrong_usage_ends_with_two")
def _(it: Tried) -> Outcome:
    return it.train(it.balls(), "--base-rate", "1e30", "--quiet", method="ringlight").refuses("--base-rate")


@finding("L4", "views that train and test are said", "data/test_splits.py::test_views_that_train_and_test_are_said")
def _(it: Tried) -> Outcome:
    names = [f"images/{index:04d}.png" for index in range(9)]
    document = nerfstudio_document() | {"train_filenames": names[:6], "test_filenames": names[4:]}
    return it.train(write_nerfstudio(it.folder / "scene", document)).says("for training and for testing")


@finding("L5a", "a dry run is JSON if asked", "cli/test_json.py::test_a_dry_run_lists_what_the_lines_say")
def _(it: Tried) -> Outcome:
    done = it("study", "rank", it.balls(), "--dry-run", "--json", "--out", it.folder / "out")
    return isinstance(json.loads(done.out), dict), "JSON"


@finding("L5b", "no variant is not all", f"{HERE}::test_a_study_of_no_variant_is_no_study_of_all")
def _(it: Tried) -> Outcome:
    words = ("--dry-run", "--out", it.folder / "out", "--only")
    return it("study", "rank", it.balls(), *words).refuses("--only")


@finding("L5c", "a study is called STUDY", f"{HERE}::test_a_study_of_no_variant_is_no_study_of_all")
def _(it: Tried) -> Outcome:
    return it("study", "bogus", it.balls()).refuses("STUDY")


@finding("L6", "compressing in place tells the size before", f"{HERE}::test_compressing_in_place_tells_the_size_before")
def _(it: Tried) -> Outcome:
    model = it.trained() / "model.safetensors"
    done = it("compress", model, model, "--overwrite")
    [(after, before)] = re.findall(r"([\d.]+) MB instead of\s+([\d.]+) MB", done.all)
    return float(after) < float(before), f"{after} MB instead of {before} MB"


@finding("L8", "photographs may be links", "data/test_blender.py::test_photographs_may_be_links_out_of_the_folder")
def _(it: Tried) -> Outcome:
    image = it.balls() / "train" / "r_1.png"
    image.rename(it.folder / "4f3a")
    image.symlink_to(it.folder / "4f3a")
    return it.train(it.folder / "balls").passes


PLY = "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n"


@finding("L9a", "points that no camera sees are said", "data/test_doubts.py::test_points_that_no_camera_sees_are_said")
def _(it: Tried) -> Outcome:
    scene = write_nerfstudio(it.folder / "scene")
    (scene / "sparse_pc.ply").write_text(PLY + "".join(f"0.{index} 0 300\n" for index in range(9)))
    return it.train(scene, "--quiet").says("seen by no camera")


@finding("L9b", "a camera far away is said", "data/test_doubts.py::test_a_camera_far_from_all_others_is_named")
def _(it: Tried) -> Outcome:
    document = nerfstudio_document()
    document["frames"][3]["transform_matrix"][0][3] = 9e8
    return it.train(write_nerfstudio(it.folder / "scene", document), "--quiet").says("images/0003.png stands")


@finding(
    "L10",
    "numbers are shown where they cannot be kept",
    "cli/test_measuring.py::test_numbers_are_shown_where_they_cannot_be_kept",
)
def _(it: Tried) -> Outcome:
    done = it("eval", it.trained(), "--lpips", "--quiet", script='ulimit -f 0; "$@"')
    return done.code == 1 and "PSNR" in done.out, "numbers" if "PSNR" in done.out else "no numbers"


@finding("L11", "a layer that a model lacks is left out", f"{HERE}::test_a_layer_that_a_model_lacks_is_left_out")
def _(it: Tried) -> Outcome:
    words = ("--path", "orbit", "--frames", "1", "--layers", "color", "modulation", "--quiet")
    return it("render", it.trained(), *words).passes


@finding(
    "L12",
    "exchanged photographs are said",
    "cli/test_unplugged.py::test_photographs_that_were_exchanged_are_said_when_a_run_goes_on",
)
def _(it: Tried) -> Outcome:
    scene = shutil.copytree(it.toaster, it.folder / "toaster")
    it.ended_by(signal.SIGTERM, it.folder / "run", scene)
    first, second = sorted((scene / "train").iterdir())[:2]
    shutil.copy(first, second)
    done = it("train", "--resume", it.folder / "run", "--quiet", "--lpips")
    holds, seen = done.says("changed since")
    return done.code == 0 and holds, seen


@finding("L13", "images_4 of full size is refused", "data/test_colmap.py::test_a_resized_folder_that_is_not_is_refused")
def _(it: Tried) -> Outcome:
    scene = write_colmap(it.folder / "scene")
    shutil.copytree(scene / "images", scene / "images_4")
    return it.train(scene, "--downscale", "4", "--quiet").refuses("images_4")


@finding(
    "L15a",
    "a name of 100 kB is cut",
    "data/test_nerfstudio.py::test_what_no_file_can_be_called_is_not_shown_whole",
)
def _(it: Tried) -> Outcome:
    document = nerfstudio_document()
    document["frames"][3]["file_path"] = "x" * 100_000
    done = it.train(write_nerfstudio(it.folder / "scene", document), "--quiet")
    return done.code == 1 and len(done.err) < 2000, f"{len(done.err)} characters"


@finding("L15b", "1 step is no 1 steps", f"{HERE}::test_one_step_is_no_steps")
def _(it: Tried) -> Outcome:
    return it.train(it.balls(), "--steps", "1").omits("1 steps")


@finding(
    "L15c", "COLUMNS=0 leaves the table", "cli/test_streams.py::test_a_table_has_room_whatever_the_terminal_claims"
)
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), COLUMNS="0")
    return "PSNR" in done.out, "a table" if "PSNR" in done.out else "no table"


@finding("L15d", "an image size", "data/test_intrinsics.py::test_a_size_that_cannot_be_is_told_in_english")
def _(it: Tried) -> Outcome:
    return it.train(write_nerfstudio(it.folder / "scene", nerfstudio_document() | {"w": 0}), "--quiet").omits(
        "has a image"
    )


@finding("L16", "help names a second run's folder", f"{HERE}::test_the_help_says_what_readmes_use")
def _(it: Tried) -> Outcome:
    return it("train", "--help").says("SCENE-METHOD-2")


@finding("L17", "a deleted folder is named", f"{HERE}::test_a_deleted_folder_is_named")
def _(it: Tried) -> Outcome:
    return it("info", "run", script='mkdir gone; cd gone; rmdir ../gone; "$@"').refuses("deleted")


@finding("L18", "wrong values come before torch", f"{HERE}::test_errors_in_values_come_before_torch")
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), "--steps", "0", PYTHONPROFILEIMPORTTIME="1")
    loaded = re.search(r"\| +torch$", done.err, re.MULTILINE)
    return done.code == 1 and not loaded, f"exit {done.code} {'after' if loaded else 'before'} torch was loaded"


@finding("L19", "train --help has --steps", f"{HERE}::test_the_help_says_what_readmes_use")
def _(it: Tried) -> Outcome:
    return it("train", "--help").says("--steps")
