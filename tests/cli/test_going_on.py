"""Runs that are extended, and runs that start from a model: recorded, resumed with the same bits, refused in a
sentence."""

import json
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from cli_session import QUICK, SMALL_LIGHT
from command import Command
from refusal import QUIET, refused, snapshot

from ringlight.errors import OutputError
from ringlight.files.ply import read_gaussian_ply, write_gaussian_ply
from ringlight.files.tensor_file import read_tensors
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs import session
from ringlight.runs.session import Session


@pytest.fixture
def finished(trained: dict[str, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))


def pressed(session: Session) -> None:
    signal.raise_signal(signal.SIGINT)


def state(run: Path) -> dict[str, torch.Tensor]:
    return read_tensors(run / "checkpoint.safetensors").tensors


def same_state(one: Path, other: Path) -> bool:
    first, second = state(one), state(other)
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


# --resume RUN --steps MORE


def test_a_finished_run_is_extended(finished: Path, ringlight: Command) -> None:
    recipe = json.loads((finished / "recipe.json").read_text())
    before, counted = state(finished), load_model(finished, rasterizer_for("cpu")).model.counted()
    done = ringlight("train", "--resume", finished, "--steps", "20", "--lpips")
    assert done.code == 0, done.err
    assert "60 steps, 20 of them added" in done.err
    record = json.loads((finished / "recipe.json").read_text())
    assert record == recipe | {"added": [20]}, "what was asked for first stays as it was"
    report = json.loads((finished / "report.json").read_text())
    assert (report["iterations"], report["planned"]) == (60, 60)
    after = state(finished)
    assert int(after["step"]) == 60
    assert not torch.equal(after["model.columns.sh_dc"], before["model.columns.sh_dc"])
    assert load_model(finished, rasterizer_for("cpu")).model.counted() == counted, "density control stays over"
    assert "step 60 of 60, 20 of them added" in ringlight("info", finished).out
    alone = shutil.copy(finished / "model.safetensors", finished.parent / "m.safetensors")
    assert "step 60, 20 of them added" in ringlight("info", alone).out


def test_a_run_is_extended_twice_and_stopped_in_between_with_the_same_bits(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step
) -> None:
    whole, stopped = (Path(shutil.copytree(trained["3dgs"], tmp_path / name)) for name in ("whole", "stopped"))
    for more in (10, 15):
        assert ringlight("train", "--resume", whole, "--steps", more, *QUIET).code == 0
    for more, at in ((10, 44), (15, 57)):
        at_step(at, pressed)
        assert ringlight("train", "--resume", stopped, "--steps", more, *QUIET).code == 130
        assert int(state(stopped)["step"]) == at
        assert ringlight("train", "--resume", stopped, *QUIET).code == 0
    assert int(state(stopped)["step"]) == 65
    assert same_state(whole, stopped)
    assert json.loads((stopped / "recipe.json").read_text())["added"] == [10, 15]


def test_a_run_that_was_stopped_is_extended_behind_its_end(
    tiny: Path, finished: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "new"
    at_step(15, pressed)
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK).code == 130
    assert ringlight("train", "--resume", run, "--steps", "10", *QUIET).code == 0
    assert ringlight("train", "--resume", finished, "--steps", "10", *QUIET).code == 0
    assert same_state(run, finished)


def test_a_run_without_a_checkpoint_is_extended_too(finished: Path, ringlight: Command) -> None:
    again = finished.with_name("again")
    again.mkdir()
    shutil.copy(finished / "recipe.json", again)
    for run in (again, finished):
        assert ringlight("train", "--resume", run, "--steps", "10", *QUIET).code == 0
    assert same_state(again, finished)


@pytest.mark.parametrize("steps", ["0", "-5", str(2**31), str(10**30)])
def test_what_is_no_number_of_steps_changes_nothing(steps: str, finished: Path, ringlight: Command) -> None:
    before = snapshot(finished)
    refused(ringlight("train", "--resume", finished, "--steps", steps, *QUIET), 1, "--steps", steps)
    assert snapshot(finished) == before


@pytest.mark.parametrize("flags", [("--eval-at", "51"), ("--preview", "-1"), ("--save-every", "0"), ("--tensorboard",)])
def test_a_refused_flag_adds_no_steps(
    flags: tuple[str, ...], finished: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    before = snapshot(finished)
    refused(ringlight("train", "--resume", finished, "--steps", "10", *flags, *QUIET), 1, flags[0])
    assert snapshot(finished) == before


@pytest.mark.parametrize("added", [[0], [-1], ["5"], [True], [2**31], 5, {"a": 1}, [1] * 10_001])
def test_a_damaged_record_of_added_steps_is_refused(added: object, finished: Path, ringlight: Command) -> None:
    record = json.loads((finished / "recipe.json").read_text()) | {"added": added}
    (finished / "recipe.json").write_text(json.dumps(record))
    before = snapshot(finished)
    refused(ringlight("train", "--resume", finished, *QUIET), 1, finished / "recipe.json", "added")
    assert snapshot(finished) == before


# train SCENE METHOD --from


SHORT = ("--steps", "6", "--initial-points", "100", *QUIET)


def start_of(run: Path, monkeypatch: pytest.MonkeyPatch, ringlight: Command, *words: object) -> dict[str, torch.Tensor]:
    """The tensors of a run at its first step."""
    with monkeypatch.context() as patched:
        patched.setattr(Session, "steps", lambda session: iter(()))
        ringlight("train", *words, "--out", run, *SHORT)
    return read_tensors(run / "model.safetensors").tensors


@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring"])
def test_a_model_of_the_same_method_is_taken_whole(
    method: str,
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    light = SMALL_LIGHT if method == "ringlight-ring" else ()
    source = trained[method]
    found = start_of(tmp_path / "a", monkeypatch, ringlight, tiny, method, "--from", source, *light)
    expected = read_tensors(source / "model.safetensors").tensors
    assert found.keys() == expected.keys()
    assert all(torch.equal(found[name], expected[name]) for name in expected)
    run = tmp_path / "b"
    done = ringlight("train", tiny, method, "--from", source, "--out", run, *light, *SHORT[:-2], "--lpips")
    assert done.code == 0, done.err
    assert f"started from {source}" in done.err
    record = json.loads((run / "recipe.json").read_text())
    assert record["start"] == str(source)
    assert record["recipe"].get("coarse_steps", 0) == 0
    assert record["recipe"]["steps"] == 6
    switch = {"3dgs": "color.active_degree", "ringlight-basis": "color.active_degree"}.get(method, "color.lit")
    after = read_tensors(run / "model.safetensors").tensors
    assert torch.equal(after[switch], expected[switch]), "what was on is not switched off"


@pytest.mark.parametrize("part", ["write_checkpoint", "save_model"])
def test_who_stops_the_first_checkpoint_hears_what_is_there(
    part: str,
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    run = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(session, part, interrupt)
        stopped = ringlight("train", tiny, "3dgs", "--from", trained["3dgs"], "--out", run, *SHORT)
    assert stopped.code == 130
    if part == "write_checkpoint":
        assert "holds nothing to go on from: begin again with --out NEW" in stopped.err
        refused(ringlight("train", "--resume", run, *QUIET), 1, run, "--out NEW")
    else:
        assert f"go on with: ringlight train --resume {run}" in stopped.err
        assert ringlight("train", "--resume", run, *QUIET).code == 0


@pytest.mark.parametrize(
    ("kind", "method"),
    [
        *(("ringlight-ring", method) for method in ("3dgs", "ringlight-basis", "ringlight-mirror")),
        *(("ply", method) for method in ("ringlight-basis", "ringlight-ring", "ringlight-mirror")),
    ],
)
def test_of_another_method_the_gaussians_are_taken_with_their_base_colours(
    kind: str,
    method: str,
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source = trained["ringlight-ring"]
    if kind == "ply":
        source = tmp_path / "a.ply"
        assert ringlight("export", trained["3dgs"], source).code == 0
    found = start_of(tmp_path / "run", monkeypatch, ringlight, tiny, method, "--from", source)
    if kind == "ply":
        table = read_gaussian_ply(source).gaussians
        columns = {name: table.columns()[name] for name in ("means", "log_scales", "quats", "opacity_logits")}
        base = (0.5 + 0.28209479177387814 * table.appearance["sh_dc"]).clamp(0, 1)
    else:
        expected = read_tensors(source / "model.safetensors").tensors
        columns = {name: expected[f"columns.{name}"] for name in ("means", "log_scales", "quats", "opacity_logits")}
        base = expected["columns.base"].sigmoid()
    for name, column in columns.items():
        assert torch.equal(found[f"columns.{name}"], column), name
    if "columns.base" in found:
        shown = found["columns.base"].sigmoid()
    else:
        shown = 0.5 + 0.28209479177387814 * found["columns.sh_dc"]
    torch.testing.assert_close(shown, base, atol=2e-3, rtol=0)
    residual = {"3dgs": "columns.sh_rest", "ringlight-basis": "columns.basis_weights"}.get(method)
    assert residual is None or not found[residual].any(), "what the view adds starts as the method starts it"


def test_a_chooser_goes_on_with_the_method_of_the_model(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    source = trained["ringlight-basis"]
    assert ringlight("train", tiny, "ringlight", "--from", source, "--out", run, *SHORT).code == 0
    record = json.loads((run / "recipe.json").read_text())
    assert (record["preset"], record["method"]) == ("ringlight", "ringlight-basis")
    ply = tmp_path / "a.ply"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    assert ringlight("train", tiny, "ringlight", "--from", ply, "--out", tmp_path / "other", *SHORT).code == 0
    record = json.loads((tmp_path / "other" / "recipe.json").read_text())
    decided = ringlight("train", tiny, "ringlight", "--out", tmp_path / "points", *SHORT)
    assert decided.code == 0
    assert record["method"] == json.loads((tmp_path / "points" / "recipe.json").read_text())["method"]


def test_a_run_that_started_from_a_model_resumes_without_it(
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    at_step,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source = Path(shutil.copytree(trained["ringlight-ring"], tmp_path / "source"))
    words = ("train", tiny, "ringlight-ring", "--from", source, *SMALL_LIGHT, *SHORT)
    assert ringlight(*words, "--out", tmp_path / "whole").code == 0
    at_step(3, pressed)
    assert ringlight(*words, "--out", tmp_path / "stopped").code == 130
    monkeypatch.undo()
    with monkeypatch.context() as patched:  # killed before its first step
        patched.setattr(Session, "steps", lambda session: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            ringlight(*words, "--out", tmp_path / "killed")
    shutil.rmtree(source)
    for name in ("stopped", "killed"):
        assert ringlight("train", "--resume", tmp_path / name, *QUIET).code == 0
        assert same_state(tmp_path / name, tmp_path / "whole")


def test_a_start_that_was_not_saved_is_not_replaced_by_points(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    assert ringlight("train", tiny, "3dgs", "--from", trained["3dgs"], "--out", run, *SHORT).code == 0
    for name in ("checkpoint.safetensors", "checkpoint-earlier.safetensors", "model.safetensors"):
        (run / name).unlink(missing_ok=True)
    refused(ringlight("train", "--resume", run, *QUIET), 1, run, trained["3dgs"], "--out NEW")


def test_a_start_that_cannot_be_saved_is_not_offered_to_go_on(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object) -> None:
        raise OutputError("the disk is full")

    monkeypatch.setattr("ringlight.runs.session.write_checkpoint", full)
    words = ("train", tiny, "3dgs", "--from", trained["3dgs"], "--out", tmp_path / "run", *SHORT)
    said = refused(ringlight(*words), 1, "the disk is full", "--out NEW")
    assert "--resume" not in said, "which would be refused"


def test_starts_that_do_not_fit_are_refused_and_nothing_is_made(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "out"

    def start(method: str, source: object, *flags: str) -> tuple:
        return ("train", tiny, method, "--from", source, "--out", out, *flags, *SHORT)

    other = ("--light.ring.rank", "2")
    refused(ringlight(*start("ringlight-ring", trained["ringlight-ring"], *SMALL_LIGHT, *other)), 1, "ringlight info")
    refused(
        ringlight(*start("3dgs", trained["3dgs"], "--sh-degree", "1")), 1, "sh_rest", trained["3dgs"], "--sh-degree 3"
    )
    refused(ringlight(*start("3dgs", tmp_path / "none.ply")), 1, tmp_path / "none.ply")
    refused(ringlight(*start("3dgs", tiny)), 1, tiny)
    cut = tmp_path / "cut.ply"
    assert ringlight("export", trained["3dgs"], cut).code == 0
    far = read_gaussian_ply(cut)
    cut.write_bytes(cut.read_bytes()[:-7])
    refused(ringlight(*start("3dgs", cut)), 1, cut)
    table = far.gaussians
    table.means.add_(1e6)
    elsewhere = tmp_path / "far.ply"
    write_gaussian_ply(elsewhere, table, table.appearance["sh_dc"], table.appearance["sh_rest"])
    refused(ringlight(*start("3dgs", elsewhere)), 1, elsewhere, "world")
    assert not out.exists()


@pytest.mark.parametrize("method", ["tensorf", "3dgs"])
def test_no_run_starts_from_a_volume(method: str, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run, out = tmp_path / "run", tmp_path / "out"
    coarse = ("--first-side", "8", "--last-side", "12", "--rays", "64")
    assert ringlight("train", tiny, "tensorf", "--out", run, *coarse, "--steps", "4", *QUIET).code == 0
    flags = coarse if method == "tensorf" else ()
    words = ("train", tiny, method, "--from", run, "--out", out, *flags, "--steps", "4", *QUIET)
    refused(ringlight(*words), 1, run, "tensorf", "--resume RUN --steps N")
    assert not out.exists()


# import


def test_what_was_exported_is_imported_again(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    ply, model = tmp_path / "a.ply", tmp_path / "m.safetensors"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    done = ringlight("import", ply, model)
    assert done.code == 0, done.err
    assert str(model) in done.out
    found, first = (load_model(path, rasterizer_for("cpu")).model for path in (model, trained["3dgs"]))
    for name, tensor in first.state_dict().items():
        if name == "columns.quats":
            tensor = torch.nn.functional.normalize(tensor, dim=-1)
        torch.testing.assert_close(found.state_dict()[name], tensor, atol=1e-7, rtol=1e-6)
    again = tmp_path / "b.ply"
    assert ringlight("export", model, again).code == 0
    one, two = (read_gaussian_ply(path).gaussians.columns() for path in (ply, again))
    assert all(torch.allclose(one[name], two[name], atol=1e-7, rtol=1e-6) for name in one)
    refused(ringlight("import", ply, model), 1, model, "--overwrite")
    refused(ringlight("import", model), 1, model, "name a PLY of 3D Gaussians")
    beside = ringlight("import", ply, "--json")
    assert json.loads(beside.out)["file"] == str(ply.with_suffix(".safetensors"))


def test_an_imported_model_is_measured_shown_and_compared(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    ply, model, out = tmp_path / "a.ply", tmp_path / "m.safetensors", tmp_path / "measured"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    assert ringlight("import", ply, model).code == 0
    assert "not trained here" in ringlight("info", model).out
    measured = ringlight("eval", model, tiny, "--out", out, "--lpips", "--quiet")
    assert measured.code == 0, measured.err
    reports = [json.loads((folder / "report.json").read_text()) for folder in (out, trained["3dgs"])]
    assert reports[0]["psnr"] == pytest.approx(reports[1]["psnr"], abs=1e-3)
    assert (reports[0]["iterations"], reports[0]["planned"]) == (None, None)
    compared = ringlight("compare", trained["3dgs"], out)
    assert compared.code == 0, compared.err
    assert "stopped" not in compared.out + compared.err
    shown = ringlight("render", model, "--scene", tiny, "--out", tmp_path / "r", "--frames", "1", "--quiet")
    assert shown.code == 0, shown.err
    orbit = ("render", model, "--path", "orbit", "--frames", "1", "--quiet")
    refused(ringlight(*orbit), 1, model, "--scene", "camera_path.json")
    assert ringlight(*orbit, "--scene", tiny, "--out", tmp_path / "orbit").code == 0
    assert len(list((tmp_path / "orbit" / "color").iterdir())) == 1
    refused(ringlight("eval", model), 1, model, "no photographs; name their folder")
    refused(ringlight("info", ply), 1, ply, f"ringlight import {ply}")


def test_what_is_no_model_is_not_imported(tmp_path: Path, tiny: Path, ringlight: Command) -> None:
    (tmp_path / "a.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    for file in (tmp_path / "a.ply", tmp_path / "none.ply", tiny):
        refused(ringlight("import", file, tmp_path / "m.safetensors"), 1, file)
    refused(ringlight("import", tmp_path / "a.ply", tmp_path / "m.bin"), 1, "m.bin")
    for nameless in ("", ".", "/"):
        refused(ringlight("import", nameless), 1, "no such file")
    assert not (tmp_path / "m.safetensors").exists()


def test_gaussians_too_far_apart_for_a_box_are_not_imported(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    ply = tmp_path / "far.ply"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    table = read_gaussian_ply(ply).gaussians
    table.means.copy_(table.means.sign() * 3e38)
    write_gaussian_ply(ply, table, table.appearance["sh_dc"], table.appearance["sh_rest"])
    refused(ringlight("import", ply), 1, ply, "units")
    assert not ply.with_suffix(".safetensors").exists()


def test_a_foreign_ply_is_imported_as_another_parser_reads_it(tmp_path: Path, ringlight: Command) -> None:
    gsply = pytest.importorskip("gsply", reason="the third-party parser gsply is in the dev extra")
    draw = torch.Generator().manual_seed(3)
    shapes = {"means": (3,), "scales": (3,), "quats": (4,), "opacities": (), "sh0": (3,), "shN": (8, 3)}
    columns = {name: torch.randn(50, *shape, generator=draw).numpy() for name, shape in shapes.items()}
    ply = tmp_path / "foreign.ply"
    gsply.plywrite(str(ply), *columns.values())
    assert ringlight("import", ply).code == 0
    found = load_model(ply.with_suffix(".safetensors"), rasterizer_for("cpu")).model.state_dict()
    theirs = gsply.plyread(str(ply))
    ours = ("means", "log_scales", "quats", "opacity_logits", "sh_dc", "sh_rest")
    for name, other in zip(ours, columns, strict=True):
        np.testing.assert_array_equal(found[f"columns.{name}"].numpy(), getattr(theirs, other), err_msg=name)
        np.testing.assert_array_equal(found[f"columns.{name}"].numpy(), columns[other], err_msg=name)
    assert int(found["color.active_degree"]) == 2


@pytest.mark.parametrize("method", ["light-gaussian", "3dgs"])
def test_a_model_of_harmonics_that_were_cut_names_their_degree(
    method: str, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    cut = tmp_path / "cut"
    assert ringlight("train", tiny, "light-gaussian", "--out", cut, *QUICK).code == 0
    words = ("train", tiny, method, "--from", cut, "--steps", "4", *QUIET, "--out", tmp_path / "next")
    refused(ringlight(*words), 1, cut, "give --sh-degree 2,")
    assert ringlight(*words, "--sh-degree", "2").code == 0


@pytest.mark.parametrize(
    ("method", "name", "size"),
    [("ringlight-basis", "opacity_basis", 8), ("ringlight-mirror", "varying.opacity_basis", 4)],
)
def test_constant_opacities_may_begin_to_vary_and_not_the_other_way(
    method: str, name: str, size: int, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    constant, varying = tmp_path / "constant", tmp_path / "varying"
    begun = ringlight("train", tiny, method, "--no-varying-opacity", "--out", constant, *QUICK)
    assert begun.code == 0, begun.err
    done = ringlight("train", tiny, method, "--from", constant, "--out", varying, *QUICK)
    assert done.code == 0, done.err
    assert state(varying)["model.color." + name].shape == (size, 15)
    back = ringlight("train", tiny, method, "--no-varying-opacity", "--from", varying, *QUICK)
    refused(back, 1, "leave --no-varying-opacity away")


def test_a_mirror_whose_opacities_vary_keeps_the_weights_that_move_them(
    tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    varying = tmp_path / "varying"
    assert ringlight("train", tiny, "ringlight-mirror", "--out", varying, *QUICK).code == 0
    without = ringlight("train", tiny, "ringlight-mirror", "--basis-size", "0", "--from", varying, *QUICK)
    refused(without, 1, varying, "give --basis-size 4")


def test_a_mirror_goes_on_with_the_maps_that_it_has(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    finer, usual = ("--shader.levels", "8", "16", "32", "64", "128"), ("--shader.levels", "8", "16", "32", "64")
    source = tmp_path / "finer"
    assert ringlight("train", tiny, "ringlight-mirror", *finer, "--out", source, *QUICK).code == 0
    for method in ("ringlight-mirror", "ringlight"):
        run = tmp_path / method
        done = ringlight("train", tiny, method, "--from", source, "--out", run, *SHORT)
        assert done.code == 0, done.err
        assert json.loads((run / "recipe.json").read_text())["recipe"]["shader"]["levels"] == [8, 16, 32, 64, 128]
    refused(ringlight("train", tiny, "ringlight-mirror", *usual, "--from", source, *QUICK), 1, source, "of shape")
