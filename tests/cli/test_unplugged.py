"""A run that is stopped from outside: a signal, a full disk, a folder that is gone, a checkpoint that is damaged."""

import errno
import json
import os
import shutil
import signal
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from cli_session import QUICK
from command import Command, Outcome
from refusal import refused

from ringlight.core.scene import View
from ringlight.errors import BackendError
from ringlight.files.tensor_file import read_metadata
from ringlight.fit.faults import MOST_IN_A_ROW
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.saver import FIRST_SECONDS, LARGEST_SAVE_SHARE, LONGEST_PAUSE, SAVE_SECONDS, Saver
from ringlight.runs.session import Session

SAVES_OFTEN = ("--save-every", "0.0001")


def model_of(run: Path) -> bytes:
    return (run / "model.safetensors").read_bytes()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_the_step_and_saves(
    number: signal.Signals,
    code: int,
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    at_step,
) -> None:
    before = signal.getsignal(number)
    at_step(15, lambda session: signal.raise_signal(number))
    run = tmp_path / "run"
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK)
    assert stopped.code == code
    assert "stopped after step 15 and saved" in stopped.err
    assert signal.getsignal(number) is before
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert model_of(run) == model_of(trained["3dgs"])


@pytest.mark.parametrize("in_save", [False, True])
def test_a_signal_in_the_last_step_or_its_saving_saves_and_measures_nothing(
    in_save: bool,
    tiny: Path,
    trained: dict[str, Path],
    tmp_path: Path,
    ringlight: Command,
    at_step,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write = Session._write

    def signalled(session: Session, *given: object) -> None:
        signal.raise_signal(signal.SIGTERM)
        write(session, *given)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        if in_save:
            patched.setattr(Session, "_write", signalled)
        else:
            at_step(40, lambda session: signal.raise_signal(signal.SIGTERM))
        run = tmp_path / "run"
        stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK)
    monkeypatch.undo()
    assert stopped.code == 143
    assert f"that was the last, measure it with: ringlight train --resume {run}" in stopped.err
    assert not (run / "report.json").exists()
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert json.loads((run / "report.json").read_text())["iterations"] == 40
    assert model_of(run) == model_of(trained["3dgs"])


def test_a_second_signal_stops_at_once_with_its_own_code(
    tiny: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    def twice(_: Session) -> None:
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGTERM)

    at_step(3, twice)
    run = tmp_path / "run"
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK)
    assert stopped.code == 143
    assert f"begin again with: ringlight train --resume {run}" in stopped.err


def test_a_signal_that_the_parent_ignores_is_ignored(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step
) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        at_step(15, lambda session: signal.raise_signal(signal.SIGHUP))
        assert ringlight("train", tiny, "3dgs", "--out", tmp_path / "run", *QUICK).code == 0
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert model_of(tmp_path / "run") == model_of(trained["3dgs"])


def test_a_run_without_a_checkpoint_is_resumed_from_its_first_step(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(_: Session) -> None:
        raise SystemExit(137)

    at_step(3, killed)
    run = tmp_path / "run"
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK).code == 137
    monkeypatch.undo()
    assert [path.name for path in run.iterdir()] == ["recipe.json"]
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert model_of(run) == model_of(trained["3dgs"])


def test_a_full_disk_stops_the_run_with_its_last_good_checkpoint(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill_the_disk(_: Session) -> None:
        def full(handle: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", full)

    run = tmp_path / "run"
    at_step(15, fill_the_disk)
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN)
    monkeypatch.undo()
    sentence = refused(stopped, 1, "no space is left", "stopped after step 15", f"ringlight train --resume {run}")
    assert "the last good checkpoint is of step 14" in sentence
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert model_of(run) == model_of(trained["3dgs"])


def test_a_folder_that_is_gone_stops_the_run_with_a_sentence(
    tiny: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "run"
    at_step(15, lambda session: shutil.rmtree(run))
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN)
    refused(stopped, 1, "its folder does not exist", "stopped after step 15 without a checkpoint")
    assert not run.exists()


def test_a_damaged_checkpoint_is_named_and_the_older_goes_on_to_the_same_bits(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    at_step(20, lambda session: signal.raise_signal(signal.SIGTERM))
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN).code == 143
    monkeypatch.undo()
    newest = run / "checkpoint.safetensors"
    content = bytearray(newest.read_bytes())
    content[-7] ^= 4
    newest.write_bytes(content)
    resumed = ringlight("train", "--resume", run, "--quiet", "--lpips")
    assert resumed.code == 0
    warning = resumed.err.splitlines()[0]
    assert warning.startswith(f"warning: {newest}: the file is damaged")
    assert "going on from checkpoint-earlier.safetensors" in warning
    assert model_of(run) == model_of(trained["3dgs"])


@pytest.mark.parametrize("cost", [0.1, 0.3, 1, 2])
def test_saving_takes_no_more_than_its_share(cost: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock of our own, where a step takes a second: whenever the run ends, with its last checkpoint."""
    now, saved = 0.0, []

    def save() -> None:
        nonlocal now
        saved.append(now)
        now += cost

    monkeypatch.setattr("time.monotonic", lambda: now)
    saver = Saver(save, None)
    for _ in range(5000):
        now += 1
        saver.save_if_due()
        if now > 2 * cost / LARGEST_SAVE_SHARE + SAVE_SECONDS:  # the first ones have to be paid for
            assert (len(saved) + 1) * cost <= LARGEST_SAVE_SHARE * (now + cost)
    assert saved[0] == FIRST_SECONDS
    assert len(saved) > 0.9 * min(5000 / SAVE_SECONDS, LARGEST_SAVE_SHARE * 5000 / cost - 2), "no rarer than that"


def test_slow_disks_are_written_to_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    now, cost = 0.0, 50
    saved: list[float] = []

    def save() -> None:
        nonlocal now
        saved.append(now)
        now += cost

    monkeypatch.setattr("time.monotonic", lambda: now)
    saver = Saver(save, None)
    for _ in range(3000):
        now += 1
        saver.save_if_due()
    assert max(b - a for a, b in pairwise(saved)) <= LONGEST_PAUSE + cost + 1
    saved.clear()
    often = Saver(save, 10.0)
    for _ in range(100):
        now += 1
        often.save_if_due()
    assert len(saved) == 10, "who asks for an interval gets it"


def test_a_run_whose_numbers_go_wrong_is_warned_of_saved_and_stopped(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = View.image

    def broken(view: View, background: torch.Tensor) -> torch.Tensor:
        pixels = image(view, background)
        return pixels * float("nan") if view.name in names else pixels

    names = {f"train/r_{index}.png" for index in range(6)}
    monkeypatch.setattr(View, "image", broken)
    run = tmp_path / "run"
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK)
    lines = stopped.err.splitlines()
    assert stopped.code == 1
    assert sum(line.startswith("warning: step ") for line in lines) == MOST_IN_A_ROW
    assert f"step {MOST_IN_A_ROW}, view train/" in lines[-1]
    assert f"the last good checkpoint is of step {MOST_IN_A_ROW}" in lines[-1]
    assert load_model(run, rasterizer_for("auto")).header.step == MOST_IN_A_ROW
    names = {"train/r_3.png"}
    run = tmp_path / "one bad photograph"
    done = ringlight("train", tiny, "3dgs", "--out", run, *QUICK)
    assert done.code == 0
    warnings = [line for line in done.err.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 40 // 6 + 1
    assert all("train/r_3.png" in line for line in warnings)
    load_model(run, rasterizer_for("auto"))


def test_the_report_counts_the_seconds_of_saving_over_stops(
    tiny: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "run"
    at_step(15, lambda session: signal.raise_signal(signal.SIGTERM))
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN).code == 143
    before = float(read_metadata(run / "checkpoint.safetensors")["saving_seconds"])
    assert before > 0
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert json.loads((run / "report.json").read_text())["saving_seconds"] > before


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"), "not enough memory"),
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB"), "not enough memory"),
        (BackendError("9 Gaussians need more memory than a view may take; make the scales smaller"), "scales smaller"),
    ],
)
def test_what_a_step_cannot_be_given_stops_the_run_with_its_last_good_checkpoint(
    error: Exception, words: str, tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def fail(_: Session) -> None:
        raise error

    run = tmp_path / "run"
    at_step(15, fail)
    stopped = ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN)
    monkeypatch.undo()
    sentence = refused(stopped, 1, words, "stopped after step 15", f"go on with: ringlight train --resume {run}")
    assert "the last good checkpoint is of step 14" in sentence
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    assert model_of(run) == model_of(trained["3dgs"])


def test_a_run_whose_checkpoints_are_all_damaged_is_told_to_start_again(
    tiny: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "run"
    at_step(15, lambda session: signal.raise_signal(signal.SIGTERM))
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK).code == 143
    (run / "checkpoint.safetensors").write_bytes(b"")
    sentence = refused(ringlight("train", "--resume", run), 1, "the file is empty", "no other is left")
    assert sentence.endswith("start it again with --out NEW")
    assert "copy it again" not in sentence


def test_photographs_that_were_exchanged_are_said_when_a_run_goes_on(
    scene_copy: Path, tmp_path: Path, ringlight: Command, at_step, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    at_step(15, lambda session: signal.raise_signal(signal.SIGTERM))
    assert ringlight("train", scene_copy, "3dgs", "--out", run, *QUICK).code == 143
    monkeypatch.undo()
    first, second = (scene_copy / "train" / f"r_{index}.png" for index in (1, 2))
    shutil.copy(first, second)
    resumed = ringlight("train", "--resume", run, "--quiet", "--lpips")
    assert resumed.code == 0
    assert "warning: 1 training photograph (train/r_2.png) or its mask changed since the run was" in resumed.err
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").err.count("changed") == 0, "said once"


@pytest.mark.skipif(sys.platform == "win32", reason="needs locks on files")
def test_two_commands_do_not_train_one_run(tiny: Path, tmp_path: Path, ringlight: Command, at_step) -> None:
    run = tmp_path / "run"
    told: list[Outcome] = []
    at_step(15, lambda session: told.append(ringlight("train", "--resume", run)))
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK, *SAVES_OFTEN).code == 0
    refused(told[0], 1, f"{run}: ", "is training or measuring this run", "wait until that has ended")
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
