"""A run's own process: why it failed in one sentence, and that it never outlives who wants it."""

import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from ringlight.runs import one_process
from ringlight.runs.many import STOPPED, Happened, heard_of
from ringlight.runs.one_process import do_run, reason_for


def test_the_reason_is_its_last_sentence_or_what_its_end_says() -> None:
    assert reason_for(0, ["ringlight: anything"]) is None
    assert reason_for(1, ["warning: x", "ringlight: a: is full; free some", "after"]) == "a: is full; free some"
    assert reason_for(1, ["Traceback", "ValueError: b", ""]) == "its process ended with code 1: ValueError: b"
    assert "signal 9" in (reason_for(-9, []) or "")
    assert "said nothing" in (reason_for(3, []) or "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_reason_of_what_was_stopped_and_could_save_says_so(number: int) -> None:
    for code in (-number, 128 + number):
        told = reason_for(code, ["ringlight: interrupted"]) or ""
        assert told.startswith(STOPPED)
        assert f"signal {number}:" in told
    assert not (reason_for(1, ["finishing this step, then saving", "ringlight: the disk is full"]) or "").startswith(
        STOPPED
    )
    assert not (reason_for(-signal.SIGKILL, []) or "").startswith(STOPPED)


def test_its_lines_are_heard_and_it_gets_its_order(monkeypatch: pytest.MonkeyPatch) -> None:
    script = "import sys, json; order = json.loads(sys.stdin.readline()); print('no json'); print(json.dumps(order))"
    monkeypatch.setattr(one_process, "COMMAND", (sys.executable, "-c", script))
    heard: list[object] = []
    assert do_run({"a": [1, "ü"]}, heard.append, lambda: True) is None
    assert heard == [{"a": [1, "ü"]}]


def test_its_warnings_are_heard_where_it_succeeds_too(monkeypatch: pytest.MonkeyPatch) -> None:
    script = "import sys; sys.stderr.write('warning: one.png has changed\\nother\\n'); sys.stdin.readline()"
    monkeypatch.setattr(one_process, "COMMAND", (sys.executable, "-c", script))
    heard: list[Mapping[str, object]] = []
    assert do_run({}, heard.append, lambda: True) is None
    assert heard == [{"warning": "one.png has changed"}]
    assert heard_of("a", heard[0]) == Happened("told", "a", "a: warning: one.png has changed")
    assert heard_of("a", {"step": 3}) == Happened("at", "a", facts={"step": 3})


def test_its_standard_input_closes_once_it_is_not_wanted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = f"import sys; sys.stdin.read(); open({str(tmp_path / 'saved')!r}, 'w').close(); sys.exit(143)"
    monkeypatch.setattr(one_process, "COMMAND", (sys.executable, "-c", script))
    begun = time.monotonic()
    reason = do_run({}, lambda facts: None, lambda: time.monotonic() - begun < 1)
    assert reason == "stopped by signal 15: it said nothing"
    assert (tmp_path / "saved").exists()


def test_what_it_says_is_never_a_reason_to_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    script = "import sys; sys.stderr.write('x' * 1000000 + '\\n'); sys.stderr.write('ringlight: why\\n'); sys.exit(1)"
    monkeypatch.setattr(one_process, "COMMAND", (sys.executable, "-c", script))
    assert do_run({}, lambda facts: None, lambda: True) == "why"
