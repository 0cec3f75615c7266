"""A light that collapses is told of on the terminal and in the report, and a run that is stopped then goes on alike."""

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_session import QUICK, SMALL_LIGHT
from command import Command

from ringlight.fit import guard
from ringlight.fit.guard import MOST_UNDONE
from ringlight.fit.train import Progress
from ringlight.runs.resume import resume_run
from ringlight.runs.session import Session

FAR_TOO_FAST = (*QUICK, *SMALL_LIGHT, "--field-rate", "10")
"""Of 40 steps the light is on after 12; it collapses at once, also at a sixteenth of the rate."""


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look every six steps."""
    monkeypatch.setattr(guard, "CHECK_EVERY", 6)
    monkeypatch.setattr(guard, "FEWEST_LOSSES", 3)


def report_of(run: Path) -> dict[str, object]:
    return json.loads((run / "report.json").read_text())


def test_each_is_said_when_it_happens_and_kept_in_the_report(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run = tmp_path / "run"
    done = ringlight("train", tiny, "ringlight-ring", "--out", run, *FAR_TOO_FAST)
    assert done.code == 0, done.err
    report = report_of(run)
    warnings = [line for line in done.err.splitlines() if "collapsed" in line]
    assert warnings == [f"warning: {sentence}" for sentence in report["collapses"]]
    assert len(warnings) == MOST_UNDONE + 1
    assert all("step 24" in warning and "back to step 12" in warning for warning in warnings[:-1])
    assert "kept as it is" in warnings[-1]
    assert report["iterations"] == 40
    assert report["saturated_features"] == 1.0
    assert "of the light's features are saturated" in " ".join(done.out.split())
    assert ringlight("eval", run, "--lpips").code == 0
    assert report_of(run)["collapses"] == report["collapses"]


def test_who_wants_none_has_none(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run = tmp_path / "run"
    done = ringlight("train", tiny, "ringlight-ring", "--out", run, *FAR_TOO_FAST, "--no-undo-collapse")
    assert done.code == 0, done.err
    assert "collapsed" not in done.err
    assert report_of(run)["collapses"] == []


@pytest.mark.parametrize("times", [1, 3])
def test_a_run_that_is_stopped_as_it_goes_back_is_saved_there(
    times: int, tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though a checkpoint of this very step was written when it came first."""
    steps = Session.steps

    def stopped(session: Session) -> Iterator[Progress]:
        for progress in steps(session):
            if progress.collapse is not None and len(session.training.guard.collapses) == times:
                signal.raise_signal(signal.SIGTERM)
            yield progress

    whole, halves = tmp_path / "whole", tmp_path / "halves"
    assert ringlight("train", tiny, "ringlight-ring", "--out", whole, *FAR_TOO_FAST).code == 0
    with monkeypatch.context() as patched:
        patched.setattr(Session, "steps", stopped)
        often = ("--save-every", "0.0001")
        assert ringlight("train", tiny, "ringlight-ring", "--out", halves, *FAR_TOO_FAST, *often).code == 143
    assert len(resume_run(halves).training.guard.collapses) == times
    assert ringlight("train", "--resume", halves, "--quiet", "--lpips").code == 0
    assert (halves / "model.safetensors").read_bytes() == (whole / "model.safetensors").read_bytes()
    assert report_of(halves)["collapses"] == report_of(whole)["collapses"]
