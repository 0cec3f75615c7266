"""Commands of many runs that are stopped: they say that all is saved where it is."""

import signal
import time
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from ringlight.cli.main import Stopped
from ringlight.cli.many_runs import Doing, do_runs
from ringlight.runs import side_by_side
from ringlight.runs.many import STOPPED


def stopped_by(
    signals: int, reason: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> str:
    """What is said of two runs that end for this ``reason`` once so many signals came."""

    def do_run(order: Mapping[str, Any], tell: object, is_wanted: Callable[[], bool], started: object) -> str | None:
        if order["name"] == "b":  # the other has begun
            signal.raise_signal(signal.SIGTERM)
        while is_wanted():
            time.sleep(0.01)
        if order["name"] == "b" and signals > 1:
            signal.raise_signal(signal.SIGTERM)
        return reason

    monkeypatch.setattr(side_by_side, "do_run", do_run)
    with pytest.raises(Stopped) as stopped:
        do_runs({name: {"name": name} for name in "ab"}, Doing(2, 1, None, True))
    assert stopped.value.code == 128 + signal.SIGTERM
    return capsys.readouterr().err


def test_what_was_stopped_and_saved_lost_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = stopped_by(1, f"{STOPPED} by signal 15: saved", monkeypatch, capsys)
    assert said.endswith("\nstopped, nothing is lost; the same command goes on\n")
    assert "signal 15" not in said


def test_a_run_that_cannot_save_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    said = stopped_by(1, "the disk is full", monkeypatch, capsys)
    assert "a: the disk is full\n" in said
    assert "b: the disk is full\n" in said
    assert "stopped, 2 runs failed as told above" in said


def test_runs_that_were_ended_at_once_have_their_last_checkpoints(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = stopped_by(2, f"{STOPPED} by signal 15: saved", monkeypatch, capsys)
    assert "nothing is lost" not in said
    assert said.endswith(
        "\nstopped at once, runs that were under way have their last checkpoints; the same command goes on\n"
    )
