"""What cost people a run, and what stood in their way."""

import signal

from heic_sample import HEIC
from PIL import Image
from scene_folders import colmap_names, nerfstudio_document, write_colmap, write_image, write_mask, write_nerfstudio
from tried import LIVELY, Outcome, Tried, finding


@finding("H1a", "training goes on where its reader leaves", "cli/test_streams.py::test_a_training_outlives_its_output")
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), script='"$@" 2>&1 | true')
    return done.code == 0 and it.has_model, f"exit {done.code}, {'a' if it.has_model else 'no'} model"


@finding("H1b", "and where standard error is closed", "cli/test_streams.py::test_a_training_outlives_its_output")
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), script='"$@" 2>&-')
    return done.code == 0 and it.has_model, f"exit {done.code}, {'a' if it.has_model else 'no'} model"


@finding(
    "H2",
    "cropped photographs are refused",
    "data/test_intrinsics.py::test_an_image_that_was_cropped_or_stretched_is_refused_with_both_shapes",
)
def _(it: Tried) -> Outcome:
    scene = write_colmap(it.folder / "scene")
    for name in colmap_names(9):
        with Image.open(scene / "images" / name) as photograph:
            cropped = photograph.crop((0, 0, 13, 12))
        cropped.save(scene / "images" / name)
    return it.train(scene, "--quiet").refuses("13x12", "16x12")


@finding("H3", "lens distortion is removed", "data/test_nerfstudio.py::test_photographs_of_a_lens_are_undistorted")
def _(it: Tried) -> Outcome:
    return it.train(write_nerfstudio(it.folder / "scene", nerfstudio_document() | {"k1": -0.02, "p1": 0.001})).passes


@finding(
    "M1",
    "the scene is told before the trial",
    "cli/test_stages.py::test_the_scene_is_told_before_anything_is_tried_on_it",
)
def _(it: Tried) -> Outcome:
    words = ("--downscale", "2", "--steps", "3", "--lpips", "--threads", "1", "--out", it.folder / "run")
    shown = it.on_a_terminal("train", it.toaster, "ringlight", *words)
    told = next(second for second, text in shown if "toaster" in text)
    tried = next(second for second, text in shown if "writing to" in text)
    return tried - told > 1, f"the scene after {told:.1f} s, the trial's end after {tried:.1f} s"


@finding(
    "M2",
    "a run killed before its first checkpoint resumes",
    "cli/test_unplugged.py::test_a_run_without_a_checkpoint_is_resumed_from_its_first_step",
)
def _(it: Tried) -> Outcome:
    it.ended_by(signal.SIGKILL, it.folder / "run", it.toaster)
    return it("train", "--resume", it.folder / "run", "--quiet", "--lpips").passes


@finding("M3a", "a closed connection (SIGHUP) saves", "cli/test_unplugged.py::test_a_signal_ends_the_step_and_saves")
def _(it: Tried) -> Outcome:
    code = it.ended_by(signal.SIGHUP, it.folder / "run", it.toaster)
    return code == 129 and it.has_model, f"exit {code}, {'a' if it.has_model else 'no'} model"


@finding("M3b", "SIGTERM ends with 143", "cli/test_unplugged.py::test_a_signal_ends_the_step_and_saves")
def _(it: Tried) -> Outcome:
    code = it.ended_by(signal.SIGTERM, it.folder / "run", it.toaster)
    return code == 143 and it.has_model, f"exit {code}, {'a' if it.has_model else 'no'} model"


@finding(
    "M4",
    "eval leaves the report of a run that trains alone",
    "cli/test_measuring.py::test_a_run_that_is_measured_while_it_trains_keeps_the_report_of_its_end",
)
def _(it: Tried) -> Outcome:
    run = it.folder / "run"
    process = it.begun("train", it.toaster, "3dgs", *LIVELY, "--save-every", "0.1", "--out", run)
    it.wait_for(lambda: (run / "checkpoint.safetensors").exists() and it.has_model)
    process.send_signal(signal.SIGSTOP)
    done = it("eval", run, "--quiet", "--lpips")
    written = it.has_report
    process.kill()
    process.wait()
    return "PSNR" in done.out and not written, f"exit {done.code}, report {'written' if written else 'left alone'}"


@finding(
    "M5a",
    "a damaged test photograph is found first",
    "cli/test_bad_scenes.py::test_a_truncated_image_is_found_before_a_folder_is_made",
)
def _(it: Tried) -> Outcome:
    scene = it.balls()
    image = scene / "test" / "r_1.png"
    image.write_bytes(image.read_bytes()[:150])
    done = it.train(scene, "--quiet")
    begun = (it.folder / "run").exists()
    return done.code == 1 and not begun, f"exit {done.code}, {'after' if begun else 'before'} the training"


@finding(
    "M5b",
    "damaged LPIPS weights leave a column open",
    "cli/test_measuring.py::test_damaged_weights_of_lpips_leave_its_column_open",
)
def _(it: Tried) -> Outcome:
    (it.folder / "lpips-alex.safetensors").write_bytes(b"cut off")
    words = ("--downscale", "2", "--steps", "3", "--threads", "1", "--quiet", "--out", it.folder / "run")
    return it("train", it.toaster, "3dgs", *words, RINGLIGHT_CACHE=str(it.folder)).passes


@finding(
    "M6", "foreign names cannot steer a terminal", "cli/test_stages.py::test_no_name_moves_the_cursor_of_a_terminal"
)
def _(it: Tried) -> Outcome:
    done = it.train(it.balls("balls\x1b[2J"), "--quiet")
    shown = done.all + it("info", it.folder / "run").all
    return done.code == 0 and "\x1b[2J" not in shown, "raw" if "\x1b[2J" in shown else "escaped"


@finding("M7a", "a folder masks/ is used", "data/test_masks.py::test_a_masks_folder_is_used_and_said")
def _(it: Tried) -> Outcome:
    scene = write_colmap(it.folder / "scene")
    for name in colmap_names(9):
        write_mask(scene / "masks" / f"{name}.png")
    return it.train(scene).says("9 of 9 photographs", "white background")


@finding("M7b", "so is mask_path", "data/test_masks.py::test_nerfstudio_names_masks_in_its_frames")
def _(it: Tried) -> Outcome:
    document = nerfstudio_document()
    for index, frame in enumerate(document["frames"]):
        frame["mask_path"] = f"keep/{index}.png"
        write_mask(it.folder / "scene" / "keep" / f"{index}.png")
    return it.train(write_nerfstudio(it.folder / "scene", document)).says("9 of 9 photographs", "white background")


@finding(
    "M8a",
    "photographs without cameras get the command",
    "data/test_unposed.py::test_photographs_without_cameras_get_the_command",
)
def _(it: Tried) -> Outcome:
    for index in range(3):
        write_image(it.folder / "photos" / f"{index}.jpg", seed=index)
    return it.train(it.folder / "photos", "--quiet").refuses("3 photographs", "ringlight poses")


@finding("M8b", "HEIC is read", "data/test_image_formats.py::test_heic_is_read")
def _(it: Tried) -> Outcome:
    scene = write_nerfstudio(it.folder / "scene")
    for image in (scene / "images").iterdir():
        image.write_bytes(HEIC)
    return it.train(scene).passes


@finding("M8c", "formats that are read are named", "data/test_image_formats.py::test_what_is_read_is_named")
def _(it: Tried) -> Outcome:
    scene = write_nerfstudio(it.folder / "scene")
    Image.new("L", (16, 12)).save(it.folder / "a.gif")
    (it.folder / "a.gif").replace(scene / "images" / "0003.png")
    return it.train(scene, "--quiet").refuses("PNG, JPEG")


@finding("M9", "a thousand million frames are refused", "cli/test_bad_input.py::test_values_out_of_range")
def _(it: Tried) -> Outcome:
    words = ("render", it.trained(), "--path", "orbit", "--frames", "1000000000", "--quiet")
    return it(*words, script='ulimit -v 6000000; "$@"').refuses("--frames")


@finding("M10a", "help in any encoding", "cli/test_streams.py::test_a_table_is_printed_in_any_encoding")
def _(it: Tried) -> Outcome:
    return it("train", "--help", PYTHONIOENCODING="ascii").passes


@finding(
    "M10b",
    "no traceback where output is closed",
    "cli/test_streams.py::test_a_command_whose_output_is_closed_ends_as_if_it_were_not",
)
def _(it: Tried) -> Outcome:
    return it("info", it.trained(), script='"$@" >&-').passes


@finding(
    "M10c",
    "nor where a library finds no memory",
    "cli/test_first_hour.py::test_a_library_that_cannot_be_loaded_is_one_sentence",
)
def _(it: Tried) -> Outcome:
    return it("info", it.trained(), script='ulimit -v 400000; "$@"').refuses("cannot be loaded")


@finding("M11a", "all photographs can train", "data/test_splits.py::test_all_photographs_can_be_for_training")
def _(it: Tried) -> Outcome:
    return it.train(it.balls(), "--holdout-every", "0").passes


@finding(
    "M11b",
    "an empty list of test views means none",
    "data/test_splits.py::test_an_empty_list_of_test_images_means_none",
)
def _(it: Tried) -> Outcome:
    return it.train(write_nerfstudio(it.folder / "scene", nerfstudio_document() | {"test_filenames": []})).passes
