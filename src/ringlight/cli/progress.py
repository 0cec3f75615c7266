"""What a person sees while a run trains: a live line on a terminal, a line every few seconds in a log."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from typing import TYPE_CHECKING

from rich.progress import BarColumn, TaskID, TextColumn
from rich.progress import Progress as Bar

from ringlight.cli.console import Screen
from ringlight.cli.eval_at import measure_test_views, warn_of_steps_done
from ringlight.core.origin import Origin
from ringlight.core.words import MEGABYTE, counted
from ringlight.fit.train import Progress
from ringlight.measure.metrics import psnr
from ringlight.runs.saver import Saver
from ringlight.runs.session import Session
from ringlight.runs.watch import Watch

if TYPE_CHECKING:
    from ringlight.cli.run_training import RunOptions
    from ringlight.view.subject import Subject
    from ringlight.view.wishes import Wishes

LIVE_SECONDS, LOG_SECONDS = 0.25, 10.0
FIRST_LOG_SECONDS = 3.0
"""Until a log's first line, which says how long the run will take; the first steps alone would tell wrongly."""

SMOOTHING = 0.8
"""Share of the old value kept in the shown training PSNR, which jumps from photograph to photograph."""

RATE_SECONDS = 3.0
"""The shown speed is that of the last few seconds: it changes as Gaussians are added and schedules move on."""


PLACES: dict[Origin, str] = {
    "scene": "on the scene's points",
    "random": "on random points",
    "hull": "on the visual hull",
    "in hull": "anywhere in the visual hull",
}
"""Of a run's first Gaussians, by where their points come from."""


def announce(session: Session, quiet: bool) -> None:
    """Say how it is about to be trained, and where it goes; what is wrong with the run is said in any case."""
    for warning in session.warnings:
        sys.stderr.write(f"warning: {warning}\n")
    if quiet:
        return
    from ringlight import _kernels

    training = session.training
    place = f"to start with{_where(session)}" if training.step == 0 else f"going on after step {training.step}"
    if training.step == training.steps:
        place = "and no step left to do"
    added = f", {sum(session.record.added)} of them added" if session.record.added else ""
    begun = [f"started from {session.record.start}; no steps are coarse"] if session.record.start else []
    lines = [
        *([session.decided] if session.decided else []),
        *begun,
        *_dropout(session),
        f"{counted(training.steps, 'step')}{added}, seed {session.record.seed}, {training.model.counted()} {place}; "
        f"{training.model.renderer}, {_kernels.isa()}, {counted(_kernels.threads(), 'thread')}",
        f"writing to {session.folder.path}",
    ]
    sys.stderr.write("\n".join(lines) + "\n")


def _dropout(session: Session) -> list[str]:
    """What pictures lack from some step on, and with them the PSNR that is shown while the run trains."""
    from ringlight.methods.splat_recipe import SplatRecipe

    recipe = session.record.recipe
    if not isinstance(recipe, SplatRecipe) or not recipe.dropout:
        return []
    return [
        f"after step {recipe.last_whole_step} each training picture lacks {recipe.dropout:.0%} of the Gaussians "
        "(dropout), which lowers the training PSNR shown"
    ]


def _where(session: Session) -> str:
    """Where they lie, behind a comma; nothing for those of a model that the run starts from."""
    origin = session.training.origin
    return "" if origin is None else f", {PLACES[origin]}"


def show_steps(session: Session, options: "RunOptions", stopping: list[int]) -> None:
    """Run the remaining steps, showing, measuring and saving on the way; returns early once ``stopping`` fills."""
    console = Screen(stderr=True)
    live = console.is_terminal and not options.quiet
    every = LIVE_SECONDS if live else FIRST_LOG_SECONDS
    warn = partial(_warn, console)
    say: Callable[[str], None] = _nothing if options.quiet else partial(_say, console)
    meter, watch = _Meter(session), Watch(session, options.preview, options.tensorboard, warn)
    if watch.about:
        say(watch.about)
    warn_of_steps_done(options.eval_at, session, warn)
    asked = options.eval_at if options.tensorboard or not options.quiet else ()  # else nobody would see
    with closing(watch), _looked_at(session, options) as look, _bar(console, live) as bar:
        task = bar.add_task("", total=session.training.steps, completed=session.training.step, facts="")
        shown = time.monotonic()
        saver = Saver(session.save, options.save_every)
        for progress in session.steps():
            now = time.monotonic()
            bar.update(task, completed=session.training.step)
            watch.see(progress)
            unlooked = look(progress, stopping)
            if now - shown >= every or progress.step in asked:
                line = meter.line(progress, watch.words, room(console) if live else None)
                _show(bar, task, line, live, options.quiet)
                shown, every = time.monotonic(), LIVE_SECONDS if live else LOG_SECONDS
            if progress.step in asked and progress.step == session.training.step:
                measure_test_views(session, watch, say, warn)
            for warning in filter(None, (progress.fault, progress.collapse, unlooked)):
                warn(warning)
            saver.save_if_due()
            if stopping:
                bar.update(task, visible=False)  # what it says of the time left is over
                return
        bar.update(task, facts=fitting(meter.facts(), f"took {spoken(session.clock.wall)}", room(console)))


@contextmanager
def _looked_at(session: Session, options: "RunOptions") -> Iterator[Callable[[Progress, list[int]], str | None]]:
    """What a viewer does after a step, if one is asked for; it ends with the block."""
    if not options.view:
        yield lambda progress, stopping: None
        return
    from ringlight.cli.view import tell_address
    from ringlight.view.live import LiveRun
    from ringlight.view.viser_page import ViserPage

    def page(subject: "Subject", wishes: "Wishes") -> ViserPage:
        made = ViserPage(subject, wishes, options.host, options.port, is_trained=True)
        tell_address(made.address, options.host, sys.stderr)
        return made

    with closing(LiveRun(session, page)) as run:
        yield run.see


def _say(console: Screen, sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)


def _warn(console: Screen, sentence: str) -> None:
    _say(console, f"warning: {sentence}")


def _nothing(sentence: str) -> None:
    """What is said where all is quiet."""


class _Meter:
    """Turns a step into the facts shown: speed, PSNR on training views; Gaussians and bytes as in the report."""

    def __init__(self, session: Session):
        self.session = session
        self.is_first_window = True
        self.mark = (session.training.step, session.clock.wall)
        self.decibels = self.rate = math.nan

    def line(self, progress: Progress, preview: str, room: int | None) -> str:
        """In at most ``room`` characters, or in full; the last ``preview``, if there is one, before the model."""
        now = psnr(progress.prediction.color, progress.truth, progress.weights)
        smoothed = SMOOTHING * self.decibels + (1 - SMOOTHING) * now
        self.decibels = smoothed if math.isfinite(self.decibels) else now
        self._time(progress.step, self.session.clock.wall)
        left = (self.session.training.steps - progress.step) / max(self.rate, 1e-9)
        *speed, count, size = self.facts()
        return fitting([*speed, *filter(None, [preview]), count, size], f"about {spoken(left)} left", room)

    def facts(self) -> list[str]:
        """Of the last step that was looked at; a short run may have looked at none."""
        count, size = self.session.training.model.rendering_size()
        rate = [f"{self.rate:6.1f} it/s"] if math.isfinite(self.rate) else []
        training = [f"training {self.decibels:5.2f} dB"] if math.isfinite(self.decibels) else []
        return [*rate, *training, str(count), f"{size / MEGABYTE:.2f} MB"]

    def _time(self, step: int, second: float) -> None:
        """Steps a second since the mark, which moves on every few seconds, and back where the training does."""
        if step < self.mark[0]:
            self.mark, self.is_first_window = (step, second), False
        elapsed = second - self.mark[1]
        if self.is_first_window or elapsed >= RATE_SECONDS:
            self.rate = (step - self.mark[0]) / max(elapsed, 1e-9)
        if elapsed >= RATE_SECONDS:
            self.mark, self.is_first_window = (step, second), False


def fitting(facts: list[str], end: str, room: int | None) -> str:
    """The facts and, last, ``end``, which stays where ``room``, characters, is too little for all."""
    kept = len(facts)
    while kept and room is not None and len("  ".join([*facts[:kept], end])) > room:
        kept -= 1
    return "  ".join([*facts[:kept], end])


MINUTE, HOUR = 60, 3600
"""Seconds."""

STILL = 1.5
"""So many of a larger unit are told in the smaller one."""


def spoken(seconds: float) -> str:
    """A time as one says it: "50 s", "12 min", "3.5 h"."""
    if seconds < STILL * MINUTE:
        return f"{seconds:.0f} s"
    return f"{seconds / MINUTE:.0f} min" if seconds < STILL * HOUR else f"{seconds / HOUR:.1f} h"


BAR, STEPS = 20, 15
"""Characters of the bar, and of the steps and the blanks beside them."""

NARROW = 80
"""On a terminal with fewer columns there is no bar."""


def room(console: Screen) -> int:
    """Characters of a live line for facts."""
    return console.width - STEPS - (BAR if console.width >= NARROW else 0)


def _bar(console: Screen, live: bool) -> Bar:
    return Bar(
        TextColumn("{task.completed:>6.0f}/{task.total:.0f}"),
        *([BarColumn(bar_width=BAR)] if console.width >= NARROW else []),
        TextColumn("{task.fields[facts]}"),
        console=console,
        disable=not live,
        transient=False,
    )


def _show(bar: Bar, task: TaskID, line: str, live: bool, quiet: bool) -> None:
    if live:
        bar.update(task, facts=line)
    elif not quiet:
        state = bar.tasks[task]
        sys.stderr.write(f"step {state.completed:.0f}/{state.total:.0f}  {line}\n")
