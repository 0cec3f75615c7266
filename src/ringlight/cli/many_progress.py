"""What a person sees of many runs at once: on a terminal a line for each that is under way, in a log what happens."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ringlight.cli.console import Screen
from ringlight.cli.progress import spoken
from ringlight.core.words import counted
from ringlight.runs.many import Happened

LIVE_TIMES, LOG_SECONDS = 4, 30.0
"""Pictures a second on a terminal; seconds between two lines on each run in a log."""
BAR = 20


class ManyRuns:
    """Hears what happens, and shows it.

    rich draws in a thread of its own, whenever it wants to: no lock is held, for a signal's handler prints too, and
    would wait for the thread that it interrupts.
    """

    def __init__(self, names: list[str], quiet: bool, console: Screen):
        self.total, self.quiet, self.console = len(names), quiet, console
        self.width = max(map(len, names), default=0)
        self.under_way: dict[str, Mapping[str, Any]] = {}
        self.begun: dict[str, tuple[float, int]] = {}
        """When a run's first step was heard of, and which it was."""
        self.said: dict[str, float] = {}
        self.done = self.failed = 0
        self.is_live = console.is_terminal and not quiet

    def hear(self, event: Happened) -> None:
        """Take it in; failures are said even where all else is quiet."""
        line, always = self._taken_in(event, time.monotonic())
        if line is not None and (always or not self.quiet):
            self.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def _taken_in(self, event: Happened, now: float) -> tuple[str | None, bool]:
        """What is said of it, and whether even where all else is quiet."""
        if event.kind == "told":
            return event.reason, True
        if event.kind == "began":
            self.under_way[event.name] = {}
            self.said[event.name] = now
            return (None if self.is_live else f"{event.name}: begins"), False
        if event.kind == "at":
            return self._moved(event, now), False
        self.under_way.pop(event.name, None)
        self.begun.pop(event.name, None)
        if event.kind == "lost":
            return f"{event.name}: {event.reason}; it goes on elsewhere", True
        self.done += event.reason is None
        self.failed += event.reason is not None
        if event.reason is not None:
            return f"{event.name}: {event.reason}", True
        return f"{event.name}: done ({self.done} of {self.total} done)", False

    def _moved(self, event: Happened, now: float) -> str | None:
        """A line now and then, where there is no live picture."""
        if event.facts is None or event.name not in self.under_way:
            return None
        self.begun.setdefault(event.name, (now, int(event.facts["step"])))
        self.under_way[event.name] = event.facts
        if self.is_live or now - self.said[event.name] < LOG_SECONDS:
            return None
        self.said[event.name] = now
        facts = self._facts(event.name, event.facts)
        return f"{event.name}: step {event.facts['step']}/{event.facts['steps']}  {facts}"

    def _facts(self, name: str, facts: Mapping[str, Any]) -> str:
        if not facts:
            return "reading"
        if facts["step"] >= facts["steps"]:
            return "measuring"
        parts = [f"{facts['psnr']:.2f} dB"] if facts.get("psnr") is not None else []
        parts.append(f"{facts['count']:,}")
        since, first = self.begun.get(name, (0.0, facts["step"]))  # it may have ended since
        done = facts["step"] - first
        if done > 0:
            parts.append(f"about {spoken((time.monotonic() - since) / done * (facts['steps'] - facts['step']))} left")
        return "  ".join(parts)

    def __rich__(self) -> Group:
        """The lines of a live picture."""
        grid = Table.grid(padding=(0, 2))
        grid.add_column(no_wrap=True, max_width=max(16, self.console.width // 3))
        for _ in range(3):
            grid.add_column(no_wrap=True)
        under_way = self.under_way.copy()
        for name, facts in under_way.items():
            step, steps = (facts["step"], facts["steps"]) if facts else (0, 1)
            bar = ProgressBar(total=steps, completed=step, width=BAR)
            place = Text(f"{step}/{steps}" if facts else "", justify="right")
            grid.add_row(Text(name), place, bar, self._facts(name, facts))
        rest = self.total - self.done - self.failed - len(under_way)
        state = f"{self.done} of {counted(self.total, 'run')} done, {len(under_way)} under way, {rest} to come"
        return Group(grid, Text(state + (f", {self.failed} failed" if self.failed else ""), style="dim"))


@contextmanager
def showing(names: list[str], quiet: bool) -> Iterator[Callable[[Happened], None]]:
    """Inside the block, what is given to its value is shown."""
    console = Screen(stderr=True)
    runs = ManyRuns(names, quiet, console)
    if not runs.is_live:
        yield runs.hear
        return
    sys.stderr.flush()
    with Live(runs, console=console, refresh_per_second=LIVE_TIMES, transient=True):
        yield runs.hear
