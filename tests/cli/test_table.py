"""``ringlight table``: each run a process, finished ones kept, and what fails is a sentence in the table."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import Command
from PIL import Image
from refusal import refused, snapshot

from ringlight.measure.report import read_report
from ringlight.runs.planned import without_absent_masks

SETTINGS = ("--set", "3dgs.densify.begin=5", "--steps", "4", "--initial-points", "100", "--lpips", "--quiet")


def table(tiny: Path, out: Path, *more: object) -> list[str]:
    words = ("table", tiny, "toaster", "--methods", "3dgs,b=ringlight-basis", "--out", out, *SETTINGS, *more)
    return [str(word) for word in words]


def test_a_dry_run_lists_and_writes_nothing(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    listed = json.loads(ringlight(*table(tiny, out, "--dry-run", "--json", "--seeds", "0,1")).out)
    assert len(listed["runs"]) == 8
    assert {run["state"] for run in listed["runs"]} == {"to do"}
    assert listed["core_seconds"] > 0
    told = ringlight(*table(tiny, out, "--dry-run"))
    assert "4 runs, 4 to do: about" in told.out
    assert not out.exists()


def test_a_dry_run_lists_what_is_left_out(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("table", tiny, "--methods", "3dgs,4dgs", "--seeds", "0,1", "--out", tmp_path / "out", *SETTINGS)
    listed = json.loads(ringlight(*words, "--dry-run", "--json").out)
    assert [(run["method"], run["seed"]) for run in listed["runs"]] == [("3dgs", 0), ("3dgs", 1)]
    assert [(gone["method"], gone["seed"]) for gone in listed["left_out"]] == [("4dgs", 0), ("4dgs", 1)]
    assert all("4dgs" in gone["reason"] for gone in listed["left_out"])


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("toaster", "--methods", "ringlight-miror,3igs-"), ["ringlight-mirror"]),
        (("toaster", "--methods", "3dgs", "--seeds", "0,x"), ["--seeds"]),
        (("toaster", "--methods", "3dgs", "--seeds", "1,1"), ["--seeds"]),
        (("toaster", "--methods", "3dgs", "--jobs", "0"), ["--jobs"]),
        (("toaster", "--methods", "3dgs", "--steps", "0"), ["--steps"]),
        (("nowhere", "--methods", "3dgs"), ["nowhere"]),
        (("toaster", "toaster", "--methods", "3dgs"), ["toaster"]),
        (("toaster", "--methods", "3dgs", "--set", "3dgs.nothing=1"), ["nothing"]),
        (("toaster", "--methods", "3dgs", "--holdout-every", "0"), ["--holdout-every"]),
        (("toaster", "--methods", "3dgs", "--jobs", "1", "--scheduler", "tcp://h:1"), ["--jobs", "leave it out"]),
    ],
)
def test_bad_input_is_a_sentence(words: tuple[str, ...], names: list[str], tmp_path: Path, ringlight: Command) -> None:
    refused(ringlight("table", *words, "--out", tmp_path / "out"), 1, *names)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [(), ("--dry-run",)])
@pytest.mark.parametrize("runs", [("table", "--methods", "3dgs"), ("study", "rank")])
def test_a_file_in_place_of_the_folder_is_told_before_any_run(
    runs: tuple[str, ...], more: tuple[str, ...], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    file = tmp_path / "file"
    file.touch()
    for out in (file, file / "deeper" / "out"):
        refused(ringlight(*runs, tiny, "--out", out, *more), 1, f"{out}: cannot be made ({file} is a file)", "--out")
    assert list(tmp_path.iterdir()) == [file]


def test_a_folder_that_cannot_be_made_is_told_before_any_run(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "link"
    out.symlink_to(tmp_path / "gone")
    refused(ringlight("table", tiny, "--methods", "3dgs", "--out", out), 1, f"{out}: cannot be made", "--out")
    assert list(tmp_path.iterdir()) == [out]


def test_runs_that_nobody_can_do_are_told_in_the_table(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    pytest.importorskip("distributed")
    out = tmp_path / "out"
    words = ("table", tiny, "--methods", "3dgs", "--out", out, *SETTINGS, "--scheduler", "nonsense://127.0.0.1:1")
    done = ringlight(*words)
    assert done.code == 1
    told = "--scheduler nonsense://127.0.0.1:1: is no scheduler's address; give it as tcp://HOST:PORT"
    assert done.err.splitlines() == [f"ringlight: {told}"]
    told = told.replace("://", "\\://")  # in Markdown, where an address would be a link
    assert f"seed 0 is missing: {told}" in (out / "table.md").read_text()


def test_a_study_that_nobody_can_do_ends_in_the_same_sentence(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    pytest.importorskip("distributed")
    words = ("study", "rank", tiny, "--steps", "4", "--seeds", "1", "--out", tmp_path / "out", "--quiet")
    done = ringlight(*words, "--scheduler", "nonsense://127.0.0.1:1")
    assert done.code == 1
    told = "--scheduler nonsense://127.0.0.1:1: is no scheduler's address; give it as tcp://HOST:PORT"
    assert done.err.splitlines()[0] == f"ringlight: {told}"


def test_flags_that_finished_runs_do_not_heed_are_told(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("table", tiny, "--methods", "3dgs", "--out", tmp_path / "out", *SETTINGS[:-2])
    for _ in range(2):  # the same command goes on
        assert "changes nothing" not in ringlight(*words, "--lpips", "--device", "cpu").err
    told = ringlight(*words, "--lpips", "vgg", "--device", "cuda").err
    for flag in ("lpips", "device"):
        assert f"--{flag} changes nothing of 1 finished run; give another --out for that" in told


def test_runs_of_a_scene_without_masks_are_kept_until_it_has_some(
    tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    """A run keeps that it found none, whatever was asked for."""
    plain = tmp_path / "plain"
    shutil.copytree(tiny, plain)
    for path in plain.rglob("*.png"):
        Image.open(path).convert("RGB").save(path)
    words = ("table", plain, "--methods", "3dgs", "--out", tmp_path / "out", *SETTINGS)
    assert ringlight(*words).code == 0
    kept = snapshot(tmp_path / "out" / "plain")
    assert ringlight(*words).code == 0
    assert snapshot(tmp_path / "out" / "plain") == kept
    for path in plain.rglob("*.png"):
        shutil.copy(tiny / path.relative_to(plain), path)
    without_absent_masks.cache_clear()  # as in another process
    again = ringlight(*words)
    assert again.code == 1
    assert "holds a run of other settings" in " ".join(again.out.split())
    assert snapshot(tmp_path / "out" / "plain") == kept


def test_runs_with_inverted_masks_are_kept(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    masked = tmp_path / "masked"
    shutil.copytree(tiny, masked)
    for path in list(masked.rglob("*.png")):
        rgba = Image.open(path)
        mask = masked / "masks" / path.relative_to(masked)
        mask.parent.mkdir(parents=True, exist_ok=True)
        rgba.getchannel("A").point(lambda value: 255 - value).save(mask)
        rgba.convert("RGB").save(path)
    words = ("table", masked, "--methods", "3dgs", "--out", tmp_path / "out", "--invert-masks", *SETTINGS)
    assert ringlight(*words).code == 0
    kept = snapshot(tmp_path / "out" / "masked")
    assert ringlight(*words).code == 0
    assert snapshot(tmp_path / "out" / "masked") == kept


def test_what_there_is_none_of_stops_no_other(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    wrong = ("ring=ringlight-rign,3dgs", "--set", "ring.steps=9")
    words = ("table", tmp_path / "none", "toastre", tiny, "--methods", *wrong)
    listed = ringlight(*words, "--out", out, *SETTINGS, "--dry-run", "--json")
    assert [run["method"] for run in json.loads(listed.out)["runs"]] == ["3dgs"]
    twice = ("table", tiny, "--methods", "a=3dgs,a=nope", "--out", out)
    refused(ringlight(*twice), 1, "'a' twice")
    done = ringlight(*words, "--out", out, *SETTINGS)
    assert done.code == 1
    for said in (listed.err, done.err):
        assert "warning: left out: no method is called 'ringlight-rign'; perhaps you meant 'ringlight-ring'" in said
        assert f"warning: left out: {tmp_path / 'none'}: there is no such folder" in said
        assert "warning: left out: toastre: " in said
    text = (out / "table.md").read_text()
    assert len(read_report(out / tiny.name / "3dgs" / "seed-0").images) == 2
    for row, column, why in ((tiny.name, "ring", "no method is called"), (tmp_path / "none", "3dgs", "no such folder")):
        note = next(
            line for line in text.replace("\\", "").splitlines() if f"{row}, {column}, seed 0 is missing" in line
        )
        assert why in note


@pytest.mark.slow
def test_runs_are_ordinary_and_a_failure_stops_no_other(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    taken = out / "toaster" / "3dgs" / "seed-0"
    assert ringlight("train", "toaster", "3dgs", "--out", taken, "--steps", 2, "--quiet", "--lpips").code == 0
    before = snapshot(taken)
    done = ringlight(*table(tiny, out, "--jobs", "2"))
    assert done.code == 1
    assert "toaster, 3dgs, seed 0 is missing" in " ".join(done.out.split())
    assert "holds a run of other settings" in " ".join(done.out.split())
    assert snapshot(taken) == before
    assert {path.name for path in out.iterdir()} == {
        "balls", "toaster", "table.md", "table.tex", "table.csv", "table.json", "table.png",
    }  # fmt: skip
    run = out / "balls" / "b" / "seed-0"
    alone = tmp_path / "alone"
    short = ("--steps", 4, "--initial-points", 100, "--quiet", "--lpips")
    assert ringlight("train", tiny, "ringlight-basis", "--out", alone, *short).code == 0
    assert (run / "model.safetensors").read_bytes() == (alone / "model.safetensors").read_bytes()
    rows = list(csv.DictReader((out / "table.csv").read_text().splitlines()))
    assert len(rows) == 3
    assert float(rows[-1]["psnr"]) == read_report(out / rows[-1]["scene"] / rows[-1]["method"] / "seed-0").psnr
    kept = snapshot(out / "balls")
    again = ringlight(*table(tiny, out, "--json"))
    assert snapshot(out / "balls") == kept
    assert json.loads(again.out)["measures"]["psnr"]["scenes"]["toaster"]["3dgs"] is None


@pytest.mark.slow
def test_volumes_are_runs_like_others(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    """Their recipes leave their box to the scene."""
    out = tmp_path / "out"
    sides = ("tensorf.first-side=8", "tensorf.last-side=12", "putt.coarsest=8", "putt.finest=16")
    settings = (word for setting in (*sides, "tensorf.rays=64", "putt.rays=64") for word in ("--set", setting))
    words = ("table", tiny, "--methods", "tensorf,putt", "--out", out, "--steps", 4, "--lpips", "--quiet", *settings)
    assert ringlight(*words).code == 0
    kept = snapshot(out / "balls")
    again = ringlight(*words, "--json")
    assert again.code == 0
    assert snapshot(out / "balls") == kept
    found = json.loads(again.out)["measures"]["psnr"]["scenes"]["balls"]
    assert all(found[method] is not None for method in ("tensorf", "putt"))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupt_loses_nothing(number: signal.Signals, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    words = (
        "table",
        "toaster",
        "--methods",
        "3dgs",
        "--out",
        str(out),
        "--quiet",
        "--lpips",
        "--initial-points",
        "500",
    )
    long = [*words, "--steps", "100000"]
    command = subprocess.Popen([sys.executable, "-m", "ringlight", *long], stderr=subprocess.PIPE, text=True)
    run = out / "toaster" / "3dgs" / "seed-0"
    _wait_for(lambda: (run / "checkpoint.safetensors").exists())
    command.send_signal(number)
    _, complaints = command.communicate(timeout=60)
    assert command.returncode == (130 if number is signal.SIGINT else -signal.SIGKILL)
    if number is signal.SIGINT:
        assert "nothing is lost" in complaints
    _wait_for(lambda: not _is_locked(run))
    assert not (run / "report.json").exists()
    listed = json.loads(ringlight(*long, "--dry-run", "--json").out)
    assert [found["state"] for found in listed["runs"]] == ["started"]


def test_a_table_is_not_replaced_by_one_without_runs(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    """As with other steps, which the folders of the finished runs cannot take."""
    out = tmp_path / "out"
    words = ("table", tiny, "--methods", "3dgs", "--out", out, *SETTINGS)
    assert ringlight(*words).code == 0
    tables = {path: path.read_bytes() for path in out.glob("table.*")}
    assert len(tables) == 5
    other = ringlight(*words, "--steps", "6", "--json")
    assert other.code == 1
    assert json.loads(other.out)["notes"]
    assert f"the earlier table in {out} is kept, for none of these runs is there" in other.err
    assert {path: path.read_bytes() for path in out.glob("table.*")} == tables
    for path in tables:
        path.unlink()
    assert ringlight(*words, "--steps", "6").code == 1
    empty = (out / "table.csv").read_text()
    assert ringlight(*words, "--steps", "7").code == 1, "a table without runs is replaced"
    assert (out / "table.csv").read_text() == empty
    assert "steps 7" not in (out / "table.md").read_text()


def _is_locked(run: Path) -> bool:
    import fcntl

    handle = os.open(run, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def _wait_for(condition, seconds: float = 120) -> None:  # type: ignore[no-untyped-def]
    last = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < last, "it never came"
        time.sleep(0.1)
