"""What a command does before there is a result: a live line on a terminal, now and then a line in a log.

No library is needed for it: the first line stands there before torch is loaded.
"""

import math
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ringlight.cli.streams import Lasting, printable
from ringlight.core.stages import heard_by

Tell = Callable[[int, int], None]
"""Called with what is done and what there is in all."""

LIVE_SECONDS, LOG_SECONDS = 0.1, 10.0
TICK_SECONDS = 1.0
"""What cannot be counted, such as loading torch, shows how long it has taken instead."""

BETWEEN_SECONDS = 1.0
"""From one line in a log to that of another stage: those that take less are not worth one."""

BAR = 20
"""Characters."""


class StageLine:
    """Hears of stages and shows the one that is under way; a log gets its beginning, and a line every few seconds."""

    def __init__(self, quiet: bool):
        self._screen = sys.stderr if isinstance(sys.stderr, Lasting) and sys.stderr.isatty() else None
        self._quiet = quiet
        self._stage = ""
        self._shown = self._began = -math.inf
        self._drawn = ""
        self._over = threading.Event()

    def __call__(self, stage: str, done: int = 0, total: int = 0) -> None:
        now = time.monotonic()
        if stage != self._stage:
            self._began = now
        if self._quiet or now - self._shown < self._pause(stage):
            return
        if self._screen is not None:
            self._drawn = ""  # so that the clock waits meanwhile
            text = _cut(f"{stage}  {_bar(done, total)}" if total else f"{stage}  {done or ''}".rstrip())
            self._screen.draw(text)
            self._drawn = "" if done or total else text
        else:
            amount = f": {done}/{total}" if total else f": {done}" if done else ""
            sys.stderr.write(f"{stage}{amount}\n")
            sys.stderr.flush()
        self._stage, self._shown = stage, now

    def tick(self) -> None:
        """On a terminal: show every second how long a stage that cannot be counted has taken, until it is over."""
        while not self._over.wait(TICK_SECONDS):
            before, text = self._drawn, _cut(f"{self._stage}  {time.monotonic() - self._began:.0f} s")
            if self._screen is not None and self._screen.redraw(before, text) and self._drawn == before:
                self._drawn = text

    @property
    def is_live(self) -> bool:
        """Whether it is drawn anew in one place."""
        return self._screen is not None

    def _pause(self, stage: str) -> float:
        if self._screen is not None:
            return LIVE_SECONDS if stage == self._stage else 0.0
        return LOG_SECONDS if stage == self._stage else BETWEEN_SECONDS

    def wiped(self) -> None:
        """Nothing is under way any more, or something that shows itself."""
        if self._screen is not None:
            self._screen.draw("")

    def end(self) -> None:
        """Wiped, and its clock stopped."""
        self._over.set()
        self.wiped()


@contextmanager
def stages(quiet: bool) -> Iterator[StageLine]:
    """Inside the block stages are shown, by whatever module they are told."""
    line = StageLine(quiet)
    if not quiet and line.is_live:
        threading.Thread(target=line.tick, daemon=True).start()
    try:
        with heard_by(line):
            yield line
    finally:
        line.end()


@contextmanager
def counting(label: str, quiet: bool = False) -> Iterator[Tell]:
    """The same for work that says itself how far it is."""
    with stages(quiet) as line:
        line(label)
        yield lambda done, total: line(label, done, total)


def _bar(done: int, total: int) -> str:
    filled = BAR * min(done, total) // total
    return f"[{'=' * filled}{' ' * (BAR - filled)}] {done}/{total}"


def _cut(line: str) -> str:
    """To one line of the terminal: a longer one could not be wiped."""
    line = printable(line)
    width = max(shutil.get_terminal_size().columns - 1, 1)
    return line if len(line) <= width else line[-width:]
