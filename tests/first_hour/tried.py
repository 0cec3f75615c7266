"""The ``ringlight`` command under trial: run as a person runs it, on scenes and runs of its own.

What is tried may be an older version with other modules, so nothing of it is imported here. Scenes are written by this
checkout.
"""

import os
import pty
import select
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scenes_on_disk import write_tiny_scene

from ringlight.data.bundled import bundled_scene

QUICK = ("--steps", "40", "--initial-points", "100", "--lpips", "--threads", "1")
LIVELY = ("--downscale", "2", "--steps", "300", "--lpips", "--threads", "1")
"""Of a bundled scene: long enough that something can happen meanwhile."""

PATIENCE = 120
"""Seconds for a command, which take five at most."""

Outcome = tuple[bool, str]
"""Whether it was as it should be, and what was seen."""


@dataclass(frozen=True)
class Said:
    """What a command left behind; ``code`` is negative where a signal ended it."""

    code: int
    out: str
    err: str

    @property
    def all(self) -> str:
        return self.out + self.err

    @property
    def last(self) -> str:
        """Its exit code and the last line that it said."""
        lines = [line.split("\r")[-1] for line in self.all.strip().splitlines()]
        return f"exit {self.code}: {lines[-1] if lines else '(nothing)'}"

    def says(self, *words: str) -> Outcome:
        lacking = [word for word in words if word not in self.all]
        return not lacking, f"exit {self.code}, does not say {lacking[0]!r}" if lacking else f"says {words[0]!r}"

    def omits(self, *words: str) -> Outcome:
        found = [word for word in words if word in self.all]
        return not found, f"says {found[0]!r}" if found else "does not say it"

    def refuses(self, *words: str) -> Outcome:
        return self.code in (1, 2) and "Traceback" not in self.err and all(
            word in self.err for word in words
        ), self.last

    @property
    def passes(self) -> Outcome:
        return self.code == 0, self.last


@dataclass
class Finding:
    """One thing that was found: a name, what should be, the test that holds it, and the trial."""

    name: str
    expected: str
    test: str
    trial: "Callable[[Tried], Outcome]"


FINDINGS: list[Finding] = []


def finding(
    name: str, expected: str, test: str
) -> "Callable[[Callable[[Tried], Outcome]], Callable[[Tried], Outcome]]":
    """Make a function of the command under trial the trial of a finding; ``test`` is FILE::NAME below tests/."""

    def add(trial: "Callable[[Tried], Outcome]") -> "Callable[[Tried], Outcome]":
        FINDINGS.append(Finding(name, expected, test, trial))
        return trial

    return add


def ended(process: "subprocess.Popen[bytes]") -> int:
    """The exit code; a process that does not end is killed."""
    try:
        return process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


class Tried:
    """A version of the command, by the interpreter that has it, with a folder to try one finding in."""

    def __init__(self, python: str, home: Path):
        self.python, self.home = python, home
        self.folder = home
        self._trained: Path | None = None

    def begin(self, name: str) -> None:
        """A new folder for the next trial."""
        self.folder = self.home / name
        self.folder.mkdir()

    def __call__(self, *words: object, script: str = '"$@"', **environment: str) -> Said:
        """Through a line of bash in which "$@" is the command."""
        line = ["bash", "-o", "pipefail", "-c", script, "bash", *self.line(*words)]
        try:
            done = subprocess.run(
                line,
                capture_output=True,
                timeout=PATIENCE,
                check=False,
                cwd=self.folder,
                env=self._environment(environment),
            )
        except subprocess.TimeoutExpired:
            return Said(-1, "", f"no end after {PATIENCE} s")
        return Said(done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace"))

    def line(self, *words: object) -> list[str]:
        return [self.python, "-m", "ringlight", *map(str, words)]

    def _environment(self, more: dict[str, str]) -> dict[str, str]:
        own = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "PYTHONPATH")}
        return own | {"RINGLIGHT_CACHE": str(self.home / "cache")} | more

    def begun(self, *words: object) -> "subprocess.Popen[bytes]":
        """Started, and training by now: where it writes to has been said."""
        log = self.folder / "log"
        with log.open("wb") as file:
            process = subprocess.Popen(
                self.line(*words), stdout=file, stderr=file, cwd=self.folder, env=self._environment({})
            )
        self.wait_for(lambda: b"writing to" in log.read_bytes() or process.poll() is not None)
        return process

    @staticmethod
    def wait_for(happened: Callable[[], bool]) -> None:
        """Raises TimeoutError."""
        until = time.monotonic() + PATIENCE
        while not happened():
            if time.monotonic() > until:
                raise TimeoutError(f"nothing happened in {PATIENCE} s")
            time.sleep(0.01)

    def ended_by(self, number: signal.Signals, run: Path, scene: object) -> int:
        """The exit code of a training that got the signal in its first second, as a shell sees it."""
        process = self.begun("train", scene, "3dgs", *LIVELY, "--out", run)
        process.send_signal(number)
        code = ended(process)
        return code if code >= 0 else 128 - code

    def on_a_terminal(self, *words: object) -> list[tuple[float, str]]:
        """What reaches a terminal, with the seconds since the start."""
        ours, theirs = pty.openpty()
        begun = time.monotonic()
        command, environment = self.line(*words), self._environment({"COLUMNS": "100", "TERM": "xterm"})
        process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=self.folder
        )
        os.close(theirs)
        shown = []
        try:
            while select.select([ours], [], [], PATIENCE)[0] and (part := os.read(ours, 65536)):
                shown.append((time.monotonic() - begun, part.decode(errors="replace")))
        except OSError:  # the last one has closed it
            pass
        ended(process)
        os.close(ours)
        return shown

    # scenes and runs

    @property
    def toaster(self) -> Path:
        return bundled_scene("toaster")

    def balls(self, name: str = "balls") -> Path:
        """Six masked photographs of 20x20 pixels."""
        return write_tiny_scene(self.folder / name)

    def trained(self, name: str = "run") -> Path:
        """A copy of a short run of ``3dgs``, whose scene stays."""
        if self._trained is None:
            own, self.folder = self.folder, self.home / "trained"
            self.folder.mkdir()
            scene, self._trained = self.balls(), self.folder / "run"
            done = self("train", scene, "3dgs", *QUICK, "--quiet", "--out", self._trained)
            assert done.code == 0, done.err
            self.folder = own
        return Path(shutil.copytree(self._trained, self.folder / name))

    def train(self, scene: object, *words: object, method: str = "3dgs", **how: str) -> Said:
        return self("train", scene, method, *QUICK, "--out", self.folder / "run", *words, **how)

    @property
    def has_model(self) -> bool:
        return (self.folder / "run" / "model.safetensors").is_file()

    @property
    def has_report(self) -> bool:
        return (self.folder / "run" / "report.json").is_file()
