"""``ringlight study``: a matrix of runs in folders of the usual kind, that goes on where it stopped."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from command import Command
from refusal import refused, snapshot

from ringlight.measure.report import read_report
from ringlight.runs import side_by_side
from ringlight.runs.record import RunRecord

WORDS = ("--steps", "3", "--base", "ringlight-ring", "--quiet", "--lpips")
ONLY = ("--only", "full", "3dgs", "3dgs-equal")
BOUNDED = ("--only", "full", "3dgs-equal", "--seeds", "1")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> Path:
    """Two scenes' worth of a finished study would say no more than one."""
    from ringlight.cli.main import run

    out = tmp_path_factory.mktemp("study") / "made" / "here"
    assert run(["study", "ablation", str(tiny), "--out", str(out), *WORDS, *ONLY]) == 0
    return out


def test_each_run_has_its_folder_and_the_study_its_table(study: Path) -> None:
    results = {f"ablation.{suffix}" for suffix in ("md", "csv", "json", "png")}
    assert {path.name for path in study.iterdir()} == {"balls", *results}
    runs = sorted(path.relative_to(study / "balls") for path in study.glob("balls/*/*"))
    assert [str(path) for path in runs] == [f"{v}/seed-{s}" for v in ("3dgs", "3dgs-equal", "full") for s in (0, 1)]
    record = json.loads((study / "ablation.json").read_text())
    assert (record["study"], record["base"], record["steps"]) == ("ablation", "ringlight-ring", 3)
    assert [row["variant"] for row in record["rows"]] == ["full", "3dgs", "3dgs-equal"]
    full = record["rows"][0]
    measured = [read_report(study / "balls" / "full" / f"seed-{seed}").psnr for seed in (0, 1)]
    assert full["psnr"]["mean"] == pytest.approx(sum(measured) / 2)
    assert full["seeds"] == 2


def test_equal_means_no_more_gaussians_than_the_full_method(study: Path) -> None:
    for seed in (0, 1):
        full = read_report(study / "balls" / "full" / f"seed-{seed}")
        record = RunRecord.read(study / "balls" / "3dgs-equal" / f"seed-{seed}")
        assert record.recipe.densify.max_gaussians == full.counted
        assert record.recipe.loss.pixel == "l2"
        assert record.preset == "3dgs"
        assert record.seed == seed


def test_the_same_command_again_trains_nothing(study: Path, tiny: Path, ringlight: Command) -> None:
    before = snapshot(study / "balls")
    done = ringlight("study", "ablation", tiny, "--out", study, *WORDS, *ONLY)
    assert done.code == 0
    assert "full" in done.out
    assert snapshot(study / "balls") == before
    told = ringlight("study", "ablation", tiny, "--out", study, *WORDS, *ONLY, "--json")
    assert json.loads(told.out)["rows"][0]["variant"] == "full"


def test_studies_in_one_folder_share_the_full_method(study: Path, tiny: Path, ringlight: Command) -> None:
    listed = ringlight("study", "rank", tiny, "--out", study, *WORDS, "--dry-run").out.splitlines()
    states = {line.split()[0]: "finished" in line for line in listed[:-1]}
    assert states.pop(str(study / "balls" / "full" / "seed-0"))
    assert states.pop(str(study / "balls" / "full" / "seed-1"))
    assert not any(states.values())
    assert listed[-1].startswith("8 runs of 3 steps, 6 to do: about ")
    assert listed[-1].endswith(" s of one core (by the finished runs)")


def test_an_interrupted_study_goes_on_to_the_same_numbers(
    study: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "out"
    words = ("study", "ablation", str(tiny), "--out", str(out), *WORDS, *BOUNDED)
    command = subprocess.Popen([sys.executable, "-m", "ringlight", *words], stderr=subprocess.PIPE, text=True)
    first = out / "balls" / "full" / "seed-0" / "checkpoint.safetensors"
    while not first.exists() and command.poll() is None:
        time.sleep(0.05)
    command.send_signal(signal.SIGINT)
    _, complaints = command.communicate(timeout=60)
    assert command.returncode == 130
    assert "the same command" in complaints
    listed = ringlight(*words, "--dry-run").out.splitlines()
    assert not all("finished" in line for line in listed[:-1])
    assert ringlight(*words, "--jobs", 2, "--threads", 1).code == 0
    for run in sorted(out.glob("balls/*/seed-0")):
        assert read_report(run).psnr == read_report(study / run.relative_to(out)).psnr


def test_a_run_that_fails_stops_those_that_wait_for_it_and_no_other(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_by_side, "do_run", failing(side_by_side.do_run, "/full/seed-0"))
    words = ("study", "ablation", tiny, "--out", tmp_path, *WORDS, *ONLY, "--seeds", "1")
    done = ringlight(*words)
    assert done.code == 1
    assert "missing: balls/full/seed-0: the disk is full" in done.err
    assert "balls/3dgs-equal/seed-0: it waited for balls/full/seed-0, which failed" in done.err
    assert [row["variant"] for row in json.loads((tmp_path / "ablation.json").read_text())["rows"]] == ["3dgs"]


def failing(do_run: Callable[..., str | None], folder: str) -> Callable[..., str | None]:
    def done(order: Mapping[str, Any], *others: object) -> str | None:
        return "the disk is full" if order["run"]["folder"].endswith(folder) else do_run(order, *others)

    return done


def test_a_dry_run_makes_nothing(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    listed = ringlight("study", "field", tiny, "carpaint", "--out", tmp_path / "out", "--dry-run")
    assert listed.code == 0
    assert "carpaint/cp/seed-1" in listed.out
    assert "24 runs of 30,000 steps, 24 to do: about 26.0 h of one core (by the README's runs; " in listed.out
    assert not any(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_told_before_any_run(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "link"
    out.symlink_to(tmp_path / "gone")
    refused(ringlight("study", "rank", tiny, "--out", out), 1, f"{out}: cannot be made", "--out")
    assert list(tmp_path.iterdir()) == [out]


def test_a_run_that_was_extended_by_hand_is_refused(
    study: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    """It has other steps than are asked for, and would be missing without a word."""
    out = Path(shutil.copytree(study, tmp_path / "study"))
    run = out / "balls" / "full" / "seed-0"
    assert ringlight("train", "--resume", run, "--steps", "2", "--quiet", "--lpips").code == 0
    refused(ringlight("study", "ablation", tiny, "--out", out, *WORDS, *ONLY), 1, run, "extended to 5 steps", "--out")


def test_a_run_without_test_views_is_no_zero(study: Path, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = Path(shutil.copytree(study, tmp_path / "study"))
    report = out / "balls" / "full" / "seed-1" / "report.json"
    report.write_text(json.dumps(json.loads(report.read_text()) | {"psnr": None}))
    refused(ringlight("study", "ablation", tiny, "--out", out, *WORDS, *ONLY), 1, report.parent, "no test views")


def test_refusals(study: Path, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = ("--out", tmp_path / "out")
    refused(ringlight("study", "ablation", *out), 2, "scene")
    refused(ringlight("study", "ablation", tmp_path / "missing", *out), 1, tmp_path / "missing", "carpaint")
    refused(ringlight("study", "rank", tiny, *out, "--only", "rank-5"), 1, "rank-5", "rank-4")
    refused(ringlight("study", "ablation", tiny, *out, "--only", "3dgs-equal"), 1, "3dgs-equal", "full")
    refused(ringlight("study", "rank", tiny, *out, "--seeds", "0"), 1, "--seeds")
    refused(ringlight("study", "rank", tiny, *out, "--steps", "-1"), 1, "--steps")
    refused(ringlight("study", "rank", tiny, *out, "--jobs", "0"), 1, "--jobs")
    refused(ringlight("study", "rank", tiny, tiny, *out), 1, tiny.name)
    assert not any(tmp_path.iterdir())
    before = snapshot(study)
    again = ("study", "ablation", tiny, "--out", study, "--base", "ringlight-ring")
    refused(ringlight(*again, "--steps", "4"), 1, study, "--out")
    refused(ringlight(*again, "--steps", "3", "--background", "black"), 1, study, "--out")
    assert snapshot(study) == before


@pytest.fixture(scope="module")
def pareto(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> Path:
    from ringlight.cli.main import run

    out = tmp_path_factory.mktemp("pareto") / "out"
    words = ("--steps", "4", "--seeds", "1", "--quiet", "--lpips", "--only", *PARETO)
    assert run(["study", "pareto", str(tiny), "--base", "ringlight-ring", "--out", str(out), *words]) == 0
    return out


PARETO = ("3dgs-steps-4", "3dgs-degree-1-size-16", "3dgs-degree-1-size-1", "ringlight-ring-size-4")


def test_pareto_bounds_models_by_bytes_not_by_gaussians(pareto: Path) -> None:
    whole = read_report(pareto / "balls" / "3dgs-steps-4" / "seed-0")
    for name, share in (("3dgs-degree-1-size-16", 16), ("3dgs-degree-1-size-1", 1), ("ringlight-ring-size-4", 4)):
        record = RunRecord.read(pareto / "balls" / name / "seed-0")
        report = read_report(pareto / "balls" / name / "seed-0")
        shared = sum(size for part, size in report.bytes_by_part.items() if not part.startswith("columns."))
        row = (report.bytes_raw - shared) / report.counted
        most = record.recipe.densify.max_gaussians
        room = whole.bytes_raw / share
        assert shared + most * row <= room < shared + (most + 1) * row


def test_pareto_has_curves_over_size_and_over_seconds(pareto: Path) -> None:
    from PIL import Image

    with Image.open(pareto / "pareto.png") as picture:
        assert picture.height > 2 * 360
    record = json.loads((pareto / "pareto.json").read_text())
    assert (record["base"], record["steps"]) == ("ringlight-ring", 4)
    assert {row["variant"] for row in record["rows"]} == set(PARETO)
    assert all(row["psnr_train"]["mean"] > 0 and row["core_seconds"]["mean"] > 0 for row in record["rows"])


def test_help_of_a_study_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    from ringlight.cli.main import run

    assert run(["study", "pareto", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: ringlight study pareto [-h]")
