"""Runs :mod:`ringlight.poses.worker`: COLMAP works in another process, which ends with this one."""

import json
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ringlight.errors import BackendError, RunError

Tell = Callable[[int, int], None]

LOG_NAME = "colmap.log"
"""In the folder for scratch files: what COLMAP printed while it did the last thing it was asked for."""

PATIENCE = 5.0
"""Seconds that a worker gets to end before it is killed."""


def require_colmap() -> None:
    """Raises BackendError where pycolmap is not installed."""
    if find_spec("pycolmap") is None:
        raise BackendError("cameras are found by pycolmap, which is not installed: pip install 'ringlight[sfm]'")


def ask_colmap(task: str, order: dict[str, Any], scratch: Path, tell: Tell) -> Any:
    """What the worker answers to ``order``; ``tell`` hears what is done and what there is in all.

    Raises:
        RunError: COLMAP failed or crashed; the sentence holds the last that it printed.
    """
    log = scratch / LOG_NAME
    with log.open("wb") as printed:
        worker = subprocess.Popen(
            [sys.executable, "-m", "ringlight.poses.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=printed,
            start_new_session=True,  # Ctrl-C is this process's to handle
        )
        try:
            answer = _converse(worker, {"task": task, **order}, tell)
        finally:
            _end(worker)
    if answer is None:
        raise RunError(f"{log}: COLMAP failed at {task} ({_last_words(log)}); what was done before is kept")
    return answer["result"]


def _converse(worker: "subprocess.Popen[bytes]", order: dict[str, Any], tell: Tell) -> dict[str, Any] | None:
    """The message with the result, or None where there was none."""
    if worker.stdin is None or worker.stdout is None:
        raise AssertionError("both are pipes")
    try:
        worker.stdin.write(json.dumps(order).encode() + b"\n")
        worker.stdin.flush()
    except BrokenPipeError:
        return None
    for line in worker.stdout:
        message: dict[str, Any] = json.loads(line)
        if "result" in message:
            return message
        tell(message["done"], message["total"])
    return None


def _end(worker: "subprocess.Popen[bytes]") -> None:
    """Closing its input ends it; killing helps where it does not listen."""
    for pipe in (worker.stdin, worker.stdout):
        if pipe is not None:
            with suppress(BrokenPipeError):
                pipe.close()
    try:
        worker.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        worker.kill()
        worker.wait()


def _last_words(log: Path) -> str:
    lines = [line for line in log.read_text("utf-8", "replace").splitlines() if line.strip()]
    complaints = [line for line in lines if "Error" in line or "Check failed" in line]
    return (complaints or lines or ["it printed nothing"])[-1].strip()[:300]
