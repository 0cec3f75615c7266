"""The commands as a person uses them, from photographs to a PLY."""

import json
import math
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from cli_session import QUICK, SMALL_LIGHT
from command import Command
from safetensors.torch import save_file
from scenes_on_disk import edit_json, picture

from ringlight.cli import checks
from ringlight.cli.export import _sentences
from ringlight.cli.progress import announce
from ringlight.core import gradients
from ringlight.files.ply import read_gaussian_ply
from ringlight.measure.lpips import tensor_shapes
from ringlight.measure.picture_names import picture_name
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs import start
from ringlight.runs.as_harmonics import BakingLoss
from ringlight.runs.export import Exported
from ringlight.runs.resume import resume_run

METHODS = ("3dgs", "ringlight-ring")
TIMED = {"fps", "fps_note", "train_seconds", "train_cpu_seconds", "saving_seconds", "steps_per_second"}
TIMED |= {"choosing_cpu_seconds", "peak_bytes", "training_bytes", "curve"}
"""Fields of a report that differ from one run to the next, or to one that was resumed."""


def numbers(report: Path) -> dict:
    return {name: value for name, value in json.loads(report.read_text()).items() if name not in TIMED}


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


# train


@pytest.mark.parametrize("method", METHODS)
def test_a_run_folder_holds_everything(method: str, trained: dict[str, Path]) -> None:
    found = files(trained[method])
    assert {"model.safetensors", "checkpoint.safetensors", "report.json", "recipe.json"} <= found
    pictures = {f"images/{kind}/{picture_name(f'test/r_{i}.png')}" for kind in ("test", "truth") for i in range(2)}
    assert found - pictures == {"model.safetensors", "checkpoint.safetensors", "report.json", "recipe.json"}
    report = json.loads((trained[method] / "report.json").read_text())
    assert report["preset"] == method
    assert report["iterations"] == 40
    assert report["counted"] != 300, "density control was at work"
    assert report["bytes_file"] == (trained[method] / "model.safetensors").stat().st_size
    assert report["background"] == "white"


def test_train_prints_a_table_or_json_and_nothing_else_on_standard_output(
    tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    words = ("train", tiny, "3dgs", "--steps", "3", "--initial-points", "100", "--lpips")
    table = ringlight(*words, "--out", tmp_path / "a")
    assert table.code == 0
    assert "PSNR" in table.out
    assert "3dgs" in table.out
    assert f"ringlight render {tmp_path / 'a'}" in table.err
    told = ringlight(*words, "--out", tmp_path / "b", "--json", "--quiet")
    assert told.code == 0
    assert json.loads(told.out)["scene"] == "balls"
    assert told.err == ""
    assert (tmp_path / "a" / "model.safetensors").read_bytes() == (tmp_path / "b" / "model.safetensors").read_bytes()


def test_an_interrupted_run_goes_on_to_the_same_bits(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "run"
    at_step(15, lambda session: signal.raise_signal(signal.SIGINT))
    stopped = ringlight("train", tiny, "ringlight-ring", "--out", run, *QUICK, *SMALL_LIGHT)
    assert stopped.code == 130
    resume = f"ringlight train --resume {run}"
    assert resume in stopped.err
    assert not (run / "report.json").exists()
    assert resume in ringlight("info", run).out
    measured = ringlight("eval", run, "--lpips", "--quiet")
    assert "stopped at step 15 of 40" in measured.out
    finished = ringlight("train", "--resume", run, "--quiet", "--lpips")
    assert finished.code == 0, finished.err
    assert (run / "model.safetensors").read_bytes() == (trained["ringlight-ring"] / "model.safetensors").read_bytes()
    assert numbers(run / "report.json") == numbers(trained["ringlight-ring"] / "report.json")


def test_a_run_stopped_while_it_is_measured_says_how_to_go_on(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ringlight.runs.finish.measure_session", pressed)
    words = ("train", tiny, "3dgs", "--steps", "2", "--initial-points", "50", "--quiet")
    stopped = ringlight(*words, "--out", tmp_path / "run")
    assert stopped.code == 130
    assert f"ringlight train --resume {tmp_path / 'run'}" in stopped.err
    assert (tmp_path / "run" / "model.safetensors").is_file()


def test_a_resumed_run_says_where_it_goes_on(trained: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    session = resume_run(trained["3dgs"])
    announce(session, quiet=False)
    assert "Gaussians and no step left to do" in capsys.readouterr().err
    session.training.step = 30
    announce(session, quiet=False)
    assert "Gaussians going on after step 30" in capsys.readouterr().err


def test_a_complete_run_is_measured_again_only_where_its_report_is_gone(run_folder: Path, ringlight: Command) -> None:
    before = {path: path.stat().st_mtime_ns for path in run_folder.rglob("*")}
    done = ringlight("train", "--resume", run_folder)
    assert done.code == 0
    assert "complete after step 40" in done.err
    assert f"ringlight eval {run_folder}" in done.err
    assert "PSNR" in done.out
    assert {path: path.stat().st_mtime_ns for path in run_folder.rglob("*")} == before
    report = (run_folder / "report.json").read_text()
    assert ringlight("train", "--resume", run_folder, "--json").out == report
    (run_folder / "report.json").unlink()
    assert ringlight("train", "--resume", run_folder, "--lpips").code == 0
    assert numbers(run_folder / "report.json") == {k: v for k, v in json.loads(report).items() if k not in TIMED}


def test_progress_counts_as_the_report_does(trained: dict[str, Path]) -> None:
    for run in trained.values():
        report = json.loads((run / "report.json").read_text())
        count, size = resume_run(run).training.model.rendering_size()
        assert (*count, size) == (report["counted"], "Gaussians", report["bytes_raw"])


def test_runs_without_a_name_stand_beside_each_other(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("train", tiny, "3dgs", "--steps", "2", "--initial-points", "50", "--lpips", "--quiet")
    assert [ringlight(*words).code for _ in range(2)] == [0, 0]
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["balls-3dgs", "balls-3dgs-2"]


def test_a_run_without_a_name_takes_another_where_its_own_is_taken_meanwhile(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare_run = start.prepare_run

    def overtaken(*given: object) -> object:
        (tmp_path / "runs" / "balls-3dgs").mkdir(parents=True)
        (tmp_path / "runs" / "balls-3dgs" / "recipe.json").write_text("of another process")
        return prepare_run(*given)  # type: ignore[arg-type]

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(start, "prepare_run", overtaken)
    assert ringlight("train", tiny, "3dgs", "--steps", "2", "--initial-points", "50", "--quiet", "--lpips").code == 0
    assert (tmp_path / "runs" / "balls-3dgs" / "recipe.json").read_text() == "of another process"
    assert (tmp_path / "runs" / "balls-3dgs-2" / "report.json").exists()


# eval


@pytest.mark.parametrize("method", METHODS)
def test_eval_gives_the_numbers_of_training(
    method: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(trained[method], tmp_path / "run"))
    before = json.loads((run / "report.json").read_text())
    (run / "report.json").unlink()
    shutil.rmtree(run / "images")
    done = ringlight("eval", run, "--lpips")
    assert done.code == 0, done.err
    assert "PSNR" in done.out
    assert f"written to {run}" in done.err
    assert numbers(run / "report.json") == numbers(trained[method] / "report.json")
    assert files(run) == files(trained[method])
    after = json.loads((run / "report.json").read_text())
    assert after["train_seconds"] == pytest.approx(before["train_seconds"]), "the checkpoint remembers the seconds"


def test_eval_keeps_the_commit_that_trained(run_folder: Path, tmp_path: Path, ringlight: Command) -> None:
    edit_json(run_folder / "report.json", lambda report: report.update(commit="of training"))
    assert ringlight("eval", run_folder, "--lpips", "--quiet", "--out", tmp_path / "apart").code == 0
    assert ringlight("eval", run_folder, "--lpips", "--quiet").code == 0
    for folder in (tmp_path / "apart", run_folder):
        assert json.loads((folder / "report.json").read_text())["commit"] == "of training"


def test_eval_gives_no_model_the_costs_of_another_step(
    trained: dict[str, Path], run_folder: Path, ringlight: Command
) -> None:
    """The report is of an earlier step: its seconds are not those of the model, which its checkpoint has."""
    whole = json.loads((run_folder / "report.json").read_text())
    edit_json(
        run_folder / "report.json",
        lambda report: report.update(iterations=whole["iterations"] - 1, train_seconds=1e6, curve=[], commit="earlier"),
    )
    done = ringlight("eval", run_folder, "--lpips", "--json", "--quiet")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["iterations"] == whole["iterations"]
    assert told["train_seconds"] == pytest.approx(whole["train_seconds"])
    assert (told["curve"], told["commit"]) == (whole["curve"], whole["commit"])
    for checkpoint in run_folder.glob("checkpoint*"):
        checkpoint.unlink()
    edit_json(run_folder / "report.json", lambda report: report.update(iterations=1))
    assert json.loads(ringlight("eval", run_folder, "--lpips", "--json", "--quiet").out)["train_seconds"] is None


def test_eval_with_images_elsewhere_keeps_the_runs_pictures_with_its_numbers(
    run_folder: Path, tmp_path: Path, ringlight: Command
) -> None:
    own = run_folder / "model.safetensors"
    assert ringlight("edit", run_folder, own, "--base-only", "--overwrite", "--quiet").code == 0
    before = (run_folder / "images" / "test" / picture_name("test/r_0.png")).read_bytes()
    assert ringlight("eval", run_folder, "--lpips", "--quiet", "--images", tmp_path / "x").code == 0
    kept = (run_folder / "images" / "test" / picture_name("test/r_0.png")).read_bytes()
    assert kept == (tmp_path / "x" / "test" / picture_name("test/r_0.png")).read_bytes() != before


def test_eval_says_which_test_views_the_model_was_trained_on(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    """By the cameras in the model's file, where a scene is split in another way than it was."""
    run = tmp_path / "run"
    words = ("--steps", "3", "--initial-points", "100", "--quiet", "--lpips", "--holdout", "train/r_0.png")
    assert ringlight("train", tiny, "3dgs", "--out", run, *words).code == 0
    done = ringlight("eval", run / "model.safetensors", tiny, "--lpips", "--quiet", "--holdout", "train/r_1.png")
    assert "was trained on 1 of the 1 test views" in done.out, done.err
    assert "was trained on" not in ringlight("eval", trained["3dgs"], "--lpips", "--quiet").out


def test_eval_of_a_model_file_writes_only_where_it_is_told(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    model = Path(shutil.copy(trained["3dgs"] / "model.safetensors", tmp_path / "model.safetensors"))
    told = ringlight("eval", model, tiny, "--lpips", "--json", "--quiet")
    assert told.code == 0
    truth = json.loads((trained["3dgs"] / "report.json").read_text())
    report = json.loads(told.out)
    assert report["psnr"] == truth["psnr"]
    assert report["seed"] is None
    assert files(tmp_path) == {"model.safetensors"}
    words = ("eval", model, tiny, "--lpips", "--out", tmp_path / "out", "--images", tmp_path / "pictures")
    assert ringlight(*words).code == 0
    assert files(tmp_path / "out") == {"report.json"}
    names = [picture_name(f"test/r_{i}.png") for i in range(2)]
    assert files(tmp_path / "pictures") == {f"{kind}/{name}" for kind in ("test", "truth") for name in names}


def test_eval_on_another_scene_leaves_the_run_alone(run_folder: Path, scene_copy: Path, ringlight: Command) -> None:
    before = (run_folder / "report.json").read_bytes()
    done = ringlight("eval", run_folder, scene_copy, "--background", "black", "--lpips")
    assert done.code == 0
    assert (run_folder / "report.json").read_bytes() == before


# render


def test_test_views_are_those_that_were_measured(run_folder: Path, ringlight: Command) -> None:
    done = ringlight("render", run_folder)
    folder = run_folder / "renders" / "test"
    assert done.out == f"{folder}\n"
    for index in range(2):
        measured = run_folder / "images" / "test" / picture_name(f"test/r_{index}.png")
        assert (picture(folder / "color" / f"r_{index}.png") == picture(measured)).all()


def test_every_layer_of_every_path(run_folder: Path, ringlight: Command) -> None:
    layers = ("color", "base", "residual", "modulation", "normal", "depth", "alpha")
    for path in ("train", "orbit", "interpolated"):
        done = ringlight("render", run_folder, "--path", path, "--frames", "3", "--layers", *layers)
        folder = run_folder / "renders" / path
        assert done.out == f"{folder}\n", done.err
        shown_frames = (0, 2, 5) if path == "train" else range(3)
        assert files(folder) == {f"{layer}/000{i}.png" for layer in layers for i in shown_frames}
        shown = {layer: picture(folder / layer / "0000.png") for layer in layers}
        assert all(image.shape == (20, 20, 3) for image in shown.values())
        assert all(image.std() > 1 for image in shown.values()), "something is to be seen"


def test_layers_add_up(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    """Over black, base plus residual is the colour, where the sum of the two was not clamped."""
    words = ("--layers", "color", "base", "residual", "--background", "black", "--out", tmp_path / "out")
    assert ringlight("render", trained["ringlight-ring"], "--frames", "1", *words).code == 0
    color, base, residual = (
        picture(tmp_path / "out" / layer / "r_0.png").astype(float) / 255 for layer in ("color", "base", "residual")
    )
    assert np.median(np.abs(base + 2 * residual - 1 - color)) < 0.02


def test_a_second_rendering_goes_beside_the_first(run_folder: Path, ringlight: Command) -> None:
    words = ("render", run_folder, "--path", "orbit", "--frames", "2", "--quiet")
    assert ringlight(*words).out == f"{run_folder / 'renders' / 'orbit'}\n"
    assert ringlight(*words).out == f"{run_folder / 'renders' / 'orbit-2'}\n"
    there = ("--out", run_folder / "renders" / "orbit")
    refused = ringlight(*words, *there)
    assert refused.code == 1
    assert "is not an empty folder; give another one with --out, or --overwrite" in refused.err
    again = ringlight(*words, *there, "--overwrite", "--scale", "2")
    assert again.code == 0
    assert picture(run_folder / "renders" / "orbit" / "color" / "0000.png").shape == (40, 40, 3)
    wide = ringlight(*words, "--out", run_folder / "wide", "--width", "30", "--background", "black")
    assert wide.code == 0
    assert picture(run_folder / "wide" / "color" / "0001.png").shape == (30, 30, 3)


def test_zooming_out_shows_the_subject_smaller(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    covered = []
    for zoom in (1.0, 0.5):
        words = ("--path", "orbit", "--frames", "1", "--layers", "alpha", "--zoom", zoom, "--out", tmp_path / str(zoom))
        assert ringlight("render", trained["3dgs"], *words).code == 0
        covered.append(picture(tmp_path / str(zoom) / "alpha" / "0000.png").astype(float).mean())
    assert 0 < covered[1] < 0.6 * covered[0], "a quarter of the area, but for the least width of a Gaussian"


def test_a_model_file_is_enough_for_an_orbit(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    model = Path(shutil.copy(trained["ringlight-ring"] / "model.safetensors", tmp_path / "m.safetensors"))
    done = ringlight("render", model, "--path", "orbit", "--frames", "1")
    assert done.out == f"{tmp_path / 'renders' / 'orbit'}\n"


def test_a_film_of_each_layer(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    av = pytest.importorskip("av")
    words = ("--path", "orbit", "--frames", "4", "--layers", "color", "depth", "--video", "--fps", "12")
    assert ringlight("render", trained["3dgs"], *words, "--out", tmp_path / "out").code == 0
    for layer in ("color", "depth"):
        with av.open(str(tmp_path / "out" / f"{layer}.mp4")) as film:
            assert len(list(film.decode(video=0))) == 4
            assert film.streams.video[0].average_rate == 12


# info


@pytest.mark.parametrize("method", METHODS)
def test_info_counts_every_byte(method: str, trained: dict[str, Path], ringlight: Command) -> None:
    facts = json.loads(ringlight("info", trained[method], "--json").out)
    report = json.loads((trained[method] / "report.json").read_text())
    assert facts["bytes_raw"] == report["bytes_raw"] == sum(facts["bytes_by_part"].values())
    assert facts["header"]["counted"] == report["counted"]
    assert facts["n_cameras"] == 6
    assert facts["run"]["psnr"] == report["psnr"]
    assert facts["run"]["has_checkpoint"]
    assert facts["run"]["resume"] is None, "the run has ended"
    assert facts["run"]["problems"] == []
    assert all(
        np.prod(t["shape"]) * {"F32": 4, "BOOL": 1, "I64": 8}[t["dtype"]] == t["bytes"] for t in facts["tensors"]
    )
    text = ringlight("info", trained[method]).out
    assert all(tensor["name"] in text for tensor in facts["tensors"])
    assert f"{report['psnr']:.2f} dB" in text
    assert "0.000 MB" not in text
    assert f"{method}, step 40 of 40\n" in text


def test_info_of_a_model_file(trained: dict[str, Path], ringlight: Command) -> None:
    facts = json.loads(ringlight("info", trained["3dgs"] / "model.safetensors", "--json").out)
    assert facts["run"] is None
    assert facts["header"]["step"] == 40


# export


def test_harmonics_are_exported_exactly(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    told = json.loads(ringlight("export", trained["3dgs"], tmp_path / "a.ply", "--json").out)
    assert told["loss"] is None
    model = load_model(trained["3dgs"], rasterizer_for("reference")).model
    found = read_gaussian_ply(tmp_path / "a.ply").gaussians
    for column in ("sh_dc", "sh_rest"):
        assert torch.equal(found.appearance[column], model.gaussians.appearance[column])
    assert torch.equal(found.means, model.gaussians.means)


@pytest.mark.parametrize(
    ("decibels", "said"),
    [(54.7, "from 40 dB on a difference is hardly seen"), (31.4, "is softer"), (24.2, "view is lost")],
)
def test_an_export_says_what_its_number_means(decibels: float, said: str) -> None:
    loss = BakingLoss(50, 0.02, 34.0, 0.04, 5, decibels, 200, 20.0, opacities_vary=False)
    exported = Exported("a.ply", 1, "Gaussians", 1, loss)
    told = _sentences(exported, exact_if_constant=True)
    assert f"{decibels} dB PSNR from pictures of the model (20.0 before 200 steps of fitting)" in told
    assert said in told
    assert "5 of 50 training cameras" in told
    assert "opacities" not in told
    varying = replace(exported, loss=replace(loss, opacities_vary=True))
    assert "opacities change with the view, and the file's do not\n" in _sentences(varying, exact_if_constant=False)
    assert "--no-varying-opacity" in _sentences(varying, exact_if_constant=True)
    assert "other viewers show" in _sentences(Exported("a.ply", 1, "Gaussians", 1, None), exact_if_constant=False)


def test_an_export_of_a_basis_says_how_to_get_an_exact_one(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    told = ringlight("export", trained["ringlight-basis"], tmp_path / "varying.ply")
    assert told.code == 0, told.err
    assert "--no-varying-opacity" in told.out
    of_ring = ringlight("export", trained["ringlight-ring"], tmp_path / "ring.ply")
    assert "opacities" not in of_ring.out


def test_a_neural_colour_is_baked_and_the_error_printed(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    done = ringlight("export", trained["ringlight-ring"], tmp_path / "a.ply")
    assert done.code == 0
    assert "rmse" in done.out
    assert "pictures of the file are" in done.out
    again = ringlight("export", trained["ringlight-ring"], tmp_path / "a.ply", "--overwrite", "--json")
    told = json.loads(again.out)
    loss = told["loss"]
    assert loss["cameras"] == 6
    assert 0 < loss["rmse"] < 0.05
    assert loss["psnr"] > 25
    assert loss["pictures"] == 5
    assert f"{loss['picture_psnr']:.1f} dB PSNR" in done.out
    assert loss["picture_psnr"] > 30
    assert len(read_gaussian_ply(tmp_path / "a.ply").gaussians) == told["counted"]


def test_pixels_that_are_shaded_are_baked_from_each_gaussians_own_surface(
    tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    assert ringlight("train", tiny, "ringlight-mirror", "--out", tmp_path / "run", *QUICK).code == 0
    told = json.loads(ringlight("export", tmp_path / "run", tmp_path / "a.ply", "--json").out)
    assert told["loss"]["opacities_vary"]
    # Shading blended surfaces is not blending shaded ones; without the shader it would be 25 dB.
    assert told["loss"]["picture_psnr"] > 28


# doctor, fetch-lpips


def test_a_healthy_machine(ringlight: Command) -> None:
    done = ringlight("doctor")
    assert done.code == 0, done.out
    assert "self test" in done.out
    assert "import ringlight before torch" in done.out
    told = json.loads(ringlight("doctor", "--json").out)
    assert told["healthy"]
    assert not {"viser", "gsplat", "pycolmap"} & {finding["name"] for finding in told["findings"]}, "nothing uses them"
    assert all(finding["remedy"] for finding in told["findings"] if finding["state"] != "ok")


def test_a_broken_module_is_essential(ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "_difference_of_rasterizers", lambda: float("nan"))
    done = ringlight("doctor")
    assert done.code == 1
    assert "problem  self test" in done.out
    assert json.loads(ringlight("doctor", "--json").out)["healthy"] is False


def test_gradients_that_are_no_numbers_are_essential(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a picture that is right."""
    dense = gradients.dense
    monkeypatch.setattr(gradients, "dense", lambda gradient: dense(gradient) * math.nan)
    found = checks._self_test()
    assert (found.state, found.essential) == ("problem", True)


def test_lpips_weights_are_fetched_once(tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def fetch(destination: Path, archive: Path | None, progress: object) -> list[Path]:
        asked.append(archive)
        made = [destination / f"lpips-{net}.safetensors" for net in ("alex", "vgg")]
        for net, path in zip(("alex", "vgg"), made, strict=True):
            save_file({name: torch.zeros(shape) for name, shape in tensor_shapes(net).items()}, path)
        return made

    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path))
    monkeypatch.setattr("ringlight.files.lpips_weights.fetch_lpips", fetch)
    assert "fetch-lpips" in ringlight("doctor").out
    for _ in range(2):
        done = ringlight("fetch-lpips")
        assert done.code == 0
        assert done.out.splitlines() == [str(tmp_path / f"lpips-{net}.safetensors") for net in ("alex", "vgg")]
    assert asked == [None], "the second time they were there"
    assert ringlight("fetch-lpips", "--archive", tmp_path / "missing.tar.gz").code == 0
    assert asked[1:] == [tmp_path / "missing.tar.gz"]
