"""A line for each stage of long work: live on a terminal, a line every few seconds in a log."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

LOG_SECONDS = 10.0


class StageLine:
    """Called with a stage, what of it is done and what there is in all; 0 in all where that is not known."""

    def __init__(self, quiet: bool):
        console = Console(stderr=True)
        self.quiet, self.live = quiet, console.is_terminal and not quiet
        columns = (TextColumn("{task.description:12}"), BarColumn(bar_width=20), TextColumn("{task.fields[amount]}"))
        self.bar = Progress(*columns, TimeRemainingColumn(elapsed_when_finished=True), console=console,
                            disable=not self.live)  # fmt: skip
        self.task: TaskID | None = None
        self.stage, self.shown = "", -LOG_SECONDS

    def __enter__(self) -> "StageLine":
        self.bar.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.bar.stop()

    def __call__(self, stage: str, done: int, total: int) -> None:
        is_new = stage != self.stage
        amount = f"{done}/{total}" if total else str(done or "")
        if is_new:
            self.stage, self.task = stage, self.bar.add_task(stage, total=None, amount="")
        if self.task is not None:
            self.bar.update(self.task, completed=done, total=total or None, amount=amount)
        now = time.monotonic()
        if not self.live and not self.quiet and (is_new or now - self.shown >= LOG_SECONDS):
            sys.stderr.write(f"{stage} {amount}".rstrip() + "\n")
            self.shown = now
