"""Sharing a model: one file that says what it holds, and sentences for what cannot be shared."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest
import torch
from cli_session import QUICK, flags
from command import Command
from refusal import refused, snapshot

from ringlight.files.model_file import read_model_file, write_model_file
from ringlight.files.tensor_file import read_metadata
from ringlight.runs import sized_page
from ringlight.runs.opened import open_model


@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring"])
def test_a_run_becomes_one_file_and_says_what_packing_cost(
    method: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "page.html"
    done = ringlight("share", trained[method], out, "--quiet")
    assert done.code == 0, done.err
    assert "Gaussians" in done.out
    assert "from 5 training cameras" in done.out
    assert [file.name for file in tmp_path.iterdir()] == ["page.html"]
    facts = facts_of(out)
    psnr = json.loads((trained[method] / "report.json").read_text())["psnr"]
    assert facts["caption"]["psnr"] == f"{psnr:.2f} dB PSNR on test views"
    assert facts["caption"]["method"] == method
    assert facts["caption"]["size"].startswith(f"{out.stat().st_size / 1e6:.2f} MB, ")
    assert facts["gaussians"] == int(read_metadata(trained[method] / "model.safetensors")["counted"])


def facts_of(page: Path) -> dict:  # type: ignore[type-arg]
    text = page.read_text("utf-8")
    begin = text.index('id="facts">') + len('id="facts">')
    found: dict = json.loads(text[begin : text.index("</script>", begin)])  # type: ignore[type-arg]
    return found


def test_equal_runs_give_equal_bytes(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    for name in ("a.html", "b.html"):
        assert ringlight("share", trained["3dgs"], tmp_path / name, "--quiet").code == 0
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_json_says_the_same(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "page.html"
    told = json.loads(ringlight("share", trained["3dgs"], out, "--json", "--quiet").out)
    assert told["bytes_file"] == out.stat().st_size
    assert told["counted"] == told["counted_before"]
    assert told["picture_psnr"] > 35


def test_a_run_without_report_and_a_packed_model_are_shared(
    run_folder: Path, tmp_path: Path, ringlight: Command
) -> None:
    (run_folder / "report.json").unlink()
    assert ringlight("share", run_folder, tmp_path / "page.html", "--quiet").code == 0
    small = tmp_path / "small.safetensors"
    assert ringlight("compress", run_folder, small, "--quiet").code == 0
    assert ringlight("share", small, tmp_path / "small.html", "--quiet").code == 0
    file = read_model_file(run_folder / "model.safetensors")
    write_model_file(tmp_path / "unmeasured.safetensors", file.tensors, replace(file.header, metrics={}))
    assert ringlight("share", tmp_path / "unmeasured.safetensors", tmp_path / "unmeasured.html", "--quiet").code == 0
    assert facts_of(tmp_path / "unmeasured.html")["caption"]["psnr"] == "PSNR not measured"


def test_a_page_that_fits_with_coarse_numbers_alone_is_written(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "page.html"
    monkeypatch.setattr(sized_page, "GOOD_ENOUGH", 0.0)
    assert ringlight("share", trained["3dgs"], out, "--quiet").code == 0
    coarse = out.stat().st_size
    monkeypatch.setattr(sized_page, "GOOD_ENOUGH", 1e3)
    monkeypatch.setattr(sized_page, "LARGEST_PAGE", coarse)
    done = ringlight("share", trained["3dgs"], out, "--overwrite", "--quiet")
    assert (done.code, out.stat().st_size) == (0, coarse), done.err


def test_a_budget_is_kept_by_leaving_out_what_shows_least(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "page.html"
    monkeypatch.setattr(sized_page, "GOOD_ENOUGH", 0.0)  # of coarse numbers, which a budget would try first
    whole = json.loads(ringlight("share", trained["3dgs"], out, "--json", "--quiet").out)
    budget = (whole["bytes_file"] - 2_000) / 1e6
    for wrong in ("0.01", "-3", "nan"):
        out_of = ringlight("share", trained["3dgs"], tmp_path / "none.html", f"--budget={wrong}", "--quiet")
        refused(out_of, 1, "--budget")
    done = ringlight("share", trained["3dgs"], out, "--budget", f"{budget:.4f}", "--overwrite", "--quiet")
    assert done.code == 0, done.err
    assert "left out" in done.out
    assert out.stat().st_size <= budget * 1e6


def test_a_thinned_page_is_the_better_of_two(trained: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """What shows least by blending weights and by effects of removal differ: the page that loses less is kept."""
    opened = open_model(trained["3dgs"])
    model = opened.stored.model.splats()
    assert model is not None
    monkeypatch.setattr(sized_page, "GOOD_ENOUGH", 0.0)  # of coarse numbers, which a budget would try first
    budget = len(sized_page.page_for(opened, model, None, ()).document) - 2_000.0
    best = sized_page.page_for(opened, model, budget, ())
    alone = []
    for name, other in (("_by_weights", "_by_effects"), ("_by_effects", "_by_weights")):
        with monkeypatch.context() as only:
            only.setattr(sized_page, other, getattr(sized_page, name))
            alone.append(sized_page.page_for(opened, model, budget, ()).decibels)
    assert alone[0] != alone[1]
    assert fmean(best.decibels) == max(map(fmean, alone))


def test_a_model_that_shows_nothing_loses_nothing(run_folder: Path, tmp_path: Path, ringlight: Command) -> None:
    file = read_model_file(run_folder / "model.safetensors")
    unseen = {"columns.opacity_logits": torch.full_like(file.tensors["columns.opacity_logits"], -20)}
    write_model_file(tmp_path / "unseen.safetensors", file.tensors | unseen, file.header)
    done = ringlight("share", tmp_path / "unseen.safetensors", tmp_path / "page.html", "--quiet")
    assert done.code == 0, done.err
    assert "no difference" in done.out


def test_a_page_that_is_too_large_is_refused_with_the_flag_that_helps(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ringlight.runs.sized_page.LARGEST_PAGE", 30_000)
    refused(ringlight("share", trained["3dgs"], tmp_path / "page.html", "--quiet"), 1, "--budget", "MB")
    assert not (tmp_path / "page.html").exists()


def test_what_exists_is_kept_unless_told_otherwise(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "page.html"
    out.write_text("mine")
    refused(ringlight("share", trained["3dgs"], out, "--quiet"), 1, out, "--overwrite")
    assert out.read_text() == "mine"
    assert ringlight("share", trained["3dgs"], out, "--overwrite", "--quiet").code == 0


def test_wrong_targets_and_models_are_refused_and_nothing_is_written(
    trained: dict[str, Path], run_folder: Path, tmp_path: Path, ringlight: Command
) -> None:
    before = snapshot(tmp_path)
    refused(ringlight("share", trained["3dgs"], tmp_path / "page.zip"), 1, ".html")
    refused(ringlight("share", trained["3dgs"], tmp_path / "missing" / "page.html"), 1, "missing")
    refused(ringlight("share", tmp_path / "nothing", tmp_path / "page.html"), 1, "nothing")
    assert snapshot(tmp_path) == before
    model = run_folder / "model.safetensors"
    os.truncate(model, model.stat().st_size // 2)
    refused(ringlight("share", run_folder, tmp_path / "page.html"), 1, model)
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_a_method_that_pages_do_not_know_is_refused_by_its_name(
    method: str, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    source = tmp_path / "run"
    assert (
        ringlight("train", tiny, method, "--steps", "2", "--out", source, "--quiet", *OF_VOLUMES.get(method, ())).code
        == 0
    )
    wanted = "made of something else" if method in OF_VOLUMES else method
    refused(ringlight("share", source, tmp_path / "page.html", "--quiet"), 1, wanted, "ringlight render")
    assert not (tmp_path / "page.html").exists()


OF_VOLUMES = {
    "tensorf": ("--first-side", "12", "--last-side", "16", "--rays", "64"),
    "putt": ("--coarsest", "4", "--finest", "8", "--rays", "64"),
}


def test_a_model_without_cameras_has_nowhere_to_look_from(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    file = read_model_file(trained["3dgs"] / "model.safetensors")
    cameras = {name: t[:0] for name, t in file.tensors.items() if name.startswith("cameras.")}
    write_model_file(tmp_path / "blind.safetensors", file.tensors | cameras, file.header)
    refused(ringlight("share", tmp_path / "blind.safetensors", tmp_path / "page.html"), 1, "no cameras")


@pytest.mark.parametrize(
    ("method", "settings", "named"),
    [
        ("ringlight-ring", flags(light__field="vm", warmup=0.3), "light.field vm"),
        ("ringlight-ring", flags(light__ring__rank=6, light__ring__position_nodes=64, warmup=0.3), "light.ring.rank 6"),
        ("ringlight-mirror", flags(shader__features=3), "shader.features 3"),
        ("3igs", flags(light__side=8, light__components=2, light__hidden=30, warmup=0.3), "light.hidden 30"),
    ],
)
def test_a_light_of_another_shape_is_refused_by_name(
    method: str, settings: tuple[str, ...], named: str, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    quick = QUICK if method != "ringlight-mirror" else (*flags(steps=5), "--quiet", "--lpips")
    assert ringlight("train", tiny, method, "--out", run, *quick, *settings).code == 0
    refused(ringlight("share", run, tmp_path / "page.html"), 1, named, "ringlight render")
    shutil.rmtree(run)
    assert not (tmp_path / "page.html").exists()
