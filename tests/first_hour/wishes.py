"""Words that nobody understood, and what was missed."""

import json

from textured_room import save_photographs
from tried import QUICK, Outcome, Tried, finding

HERE = "cli/test_first_hour.py"


@finding("W1", "first lines have no jargon", f"{HERE}::test_words_of_the_first_lines_are_those_of_photographers")
def _(it: Tried) -> Outcome:
    jargon = ("lit per pixel", "deferred", "forward", "harmonics", "visual hull", "background photograph")
    words = ("--downscale", "2", "--steps", "3", "--lpips", "--threads", "1", "--out", it.folder / "run")
    return it("train", it.toaster, "ringlight", *words).omits(*jargon)


@finding("W2", "the table is explained", f"{HERE}::test_words_of_the_first_lines_are_those_of_photographers")
def _(it: Tried) -> Outcome:
    explained = "raw MB: what showing the scene takes"
    said = " ".join(it.train(it.balls()).all.split())
    return explained in said, "explained" if explained in said else "not explained"


@finding("X1", "cameras are found", "cli/test_poses_command.py::test_train_finds_the_cameras_first")
def _(it: Tried) -> Outcome:
    save_photographs(it.folder / "photos", 6)
    done = it("poses", it.folder / "photos", "--lens", "simple-pinhole", "--quiet", "--threads", "1")
    return done.code == 0 and (it.folder / "photos-scene" / "sparse" / "0").is_dir(), done.last


@finding(
    "X2", "a camera path of one's own", "cli/test_render_paths.py::test_a_nerfstudio_path_shows_what_its_cameras_see"
)
def _(it: Tried) -> Outcome:
    document = json.loads((it.balls() / "transforms_test.json").read_text())
    pose = [value for row in document["frames"][0]["transform_matrix"] for value in row]
    frame = {"camera_to_world": pose, "fov": 40.0, "aspect": 1.0}
    path = {"camera_type": "perspective", "render_height": 20, "render_width": 20, "camera_path": [frame, frame]}
    (it.folder / "path.json").write_text(json.dumps(path | {"seconds": 2, "fps": 1}))
    return it("render", it.trained(), "--path", it.folder / "path.json", "--quiet").passes


@finding("X3", "test views by name", "data/test_splits.py::test_test_images_can_be_named")
def _(it: Tried) -> Outcome:
    return it.train(it.balls(), "--holdout", "train/r_1.png,train/r_4.png").says("3dgs", "2 test")


@finding("X4", "finished runs go on", "cli/test_going_on.py::test_a_finished_run_is_extended")
def _(it: Tried) -> Outcome:
    done = it("train", "--resume", it.trained(), "--steps", "20", "--quiet", "--lpips")
    steps = json.loads((it.folder / "run" / "report.json").read_text())["iterations"]
    return done.code == 0 and steps == 60, done.last


@finding("X5", "runs start from models", "cli/test_going_on.py::test_a_model_of_the_same_method_is_taken_whole")
def _(it: Tried) -> Outcome:
    return it("train", it.balls(), "3dgs", *QUICK, "--from", it.trained("a"), "--out", it.folder / "run").passes


@finding("X6", "PLYs become models", "cli/test_going_on.py::test_what_was_exported_is_imported_again")
def _(it: Tried) -> Outcome:
    it("export", it.trained(), it.folder / "x.ply", "--quiet")
    return it("import", it.folder / "x.ply", it.folder / "x.safetensors").passes


@finding("X7", "previews", "cli/test_watching.py::test_previews_show_one_view_and_change_no_bit")
def _(it: Tried) -> Outcome:
    done = it.train(it.balls(), "--preview", "20", "--quiet")
    return len(list((it.folder / "run" / "previews").iterdir())) > 0, done.last
