"""``python -m ringlight.cli.one_run``: one run of many, described by a line of JSON on standard input.

Writes its progress as lines of JSON. It ends its step and saves once its standard input is closed: whoever started it
has no other way to say so that still works after SIGKILL.
"""

import json
import os
import signal
import sys
import time
from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ringlight.runs.planned import PlannedRun
    from ringlight.runs.session import Session

TELL_SECONDS = 1.0
"""Between two lines of progress."""

PATIENCE = 60.0
"""Seconds in which another process may end that still holds the run: one whose worker died saves first."""


def main(arguments: list[str]) -> int:
    """Do the run of standard input; returns the exit code."""
    order: dict[str, Any] = json.loads(sys.stdin.readline())
    Thread(target=_stop_at_end_of_input, daemon=True).start()
    from ringlight.cli.run_training import RunOptions, train_and_measure
    from ringlight.cli.threads import use_threads
    from ringlight.core.command_line import command
    from ringlight.runs.finish import complete_report
    from ringlight.runs.planned import PlannedRun

    use_threads(order["threads"])
    run = PlannedRun.from_plain(order["run"])
    session = _session(run, order["device"])
    if complete_report(session) is not None:
        return 0
    done = Event()
    teller = Thread(target=_tell, args=(session, done), daemon=True)
    teller.start()
    options = RunOptions(threads=order["threads"], lpips=tuple(order["lpips"]), quiet=True)
    try:
        train_and_measure(session, options, command("train", "--resume", run.folder), _save_at_any)
    finally:
        done.set()
        teller.join()
    return 0


def _session(run: "PlannedRun", device: str) -> "Session":
    """Where another process holds the run it is waited for a while."""
    from ringlight.errors import RunError
    from ringlight.runs.folder import RunFolder
    from ringlight.runs.lock import RunLock

    last = time.monotonic() + PATIENCE
    while RunFolder(run.folder).recorded:
        try:
            RunLock(run.folder).release()
            break
        except RunError:
            if time.monotonic() > last:
                raise
            time.sleep(TELL_SECONDS)
    return run.session(device)


def _tell(session: "Session", done: Event) -> None:
    """Where the training is, until it is over."""
    while True:
        ended = done.wait(TELL_SECONDS)
        training, points = session.training, session.history.points
        facts = {
            "step": training.step,
            "steps": training.steps,
            "psnr": points[-1].psnr if points else None,
            "count": training.model.counted().number,
        }
        sys.stdout.write(json.dumps(facts) + "\n")
        sys.stdout.flush()
        if ended:
            return


def _save_at_any(number: int, before: list[int]) -> None:
    """No signal here is of an impatient user, who asks the command to end this process. Who ends a service or a job
    signals all of its processes; the command, one of them, then closes this one's standard input too."""
    if not before:
        sys.stderr.write("finishing this step, then saving\n")


def _stop_at_end_of_input() -> None:
    with suppress(OSError, ValueError):
        while sys.stdin.read(1):
            pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    from ringlight.cli.main import run_verb_alone

    run_verb_alone("one-run")
