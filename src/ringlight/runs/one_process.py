"""One run in a process of its own, watched from here: it stops, and saves, when nobody wants it any more."""

import json
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from threading import Event, Thread
from typing import Any

from ringlight.runs.many import STOPPED

COMMAND = (sys.executable, "-m", "ringlight.cli.one_run")
"""What does a run; it stands on a higher floor and is named, not imported."""

MOST_LINES = 40
"""Of what the process complains of, to find its last sentence in."""

LOOK_SECONDS = 0.5
"""Between two looks whether the run is still wanted."""

SENTENCE = "ringlight: "
"""Begins what a command says last where it fails."""

WARNING = "warning: "
"""Begins what it says of a run that goes on all the same."""

STOPPING = {
    code: number
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if (number := getattr(signal, name, None)) is not None
    for code in (-number, 128 + number)
}
"""Signals that let a run save, by the exit codes that they leave: where nothing was trained yet, and after saving."""

Tell = Callable[[Mapping[str, Any]], None]


def do_run(
    order: Mapping[str, Any],
    tell: Tell,
    is_wanted: Callable[[], bool],
    started: Callable[["subprocess.Popen[str]"], None] = lambda process: None,
) -> str | None:
    """Do the run that ``order`` describes; None where it was finished, else a sentence that says why not.

    ``tell`` gets its progress, and each warning as {"warning": sentence}. It ends its step and saves once ``is_wanted``
    says no, or once this process is gone, however that ended: the child's standard input is closed then.
    """
    # A session of its own: Ctrl-C reaches this process alone, which decides.
    process = subprocess.Popen(
        COMMAND,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, encoding="utf-8", errors="replace", start_new_session=True,
    )  # fmt: skip
    started(process)
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    complaints: deque[str] = deque(maxlen=MOST_LINES)
    done = Event()
    drain = Thread(target=_drain, args=(process.stderr, complaints, tell), daemon=True)
    watch = Thread(target=_close_when_unwanted, args=(process, is_wanted, done), daemon=True)
    drain.start()
    try:
        with suppress(OSError):  # it is gone already, and what it said follows
            process.stdin.write(json.dumps(order) + "\n")
            process.stdin.flush()
        watch.start()
        for line in process.stdout:
            with suppress(ValueError):
                tell(json.loads(line))
        code = process.wait()
    finally:
        done.set()
        process.stdout.close()
    drain.join(timeout=LOOK_SECONDS)
    for stream in (process.stdin, process.stderr):
        with suppress(OSError, ValueError):
            stream.close()
    return reason_for(code, list(complaints))


def _drain(lines: Iterable[str], complaints: deque[str], tell: Tell) -> None:
    for line in lines:
        complaints.append(line)
        if line.startswith(WARNING):
            tell({"warning": line.removeprefix(WARNING).strip()})


def reason_for(code: int, lines: list[str]) -> str | None:
    """Why a process failed: its own last sentence, or what its exit code says; STOPPED begins it where a signal ended
    the process that would let it save."""
    if code == 0:
        return None
    last = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
    if code in STOPPING:
        return f"{STOPPED} by signal {STOPPING[code]}: {last}"
    told = [line.strip().removeprefix(SENTENCE) for line in lines if line.startswith(SENTENCE)]
    if told:
        return told[-1]
    if code < 0:
        return f"its process was ended by signal {-code}; if nobody sent it, memory may have run out"
    return f"its process ended with code {code}: {last}"


def _close_when_unwanted(process: "subprocess.Popen[str]", is_wanted: Callable[[], bool], done: Event) -> None:
    while not done.wait(LOOK_SECONDS):
        if not is_wanted():
            with suppress(OSError, AttributeError):
                process.stdin.close()  # type: ignore[union-attr]  # it is a pipe
            return
