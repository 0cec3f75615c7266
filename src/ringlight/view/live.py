"""A viewer of a run that is being trained: it draws between steps, within a bounded share of the time."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from ringlight.fit.train import Progress
from ringlight.runs.session import Session
from ringlight.view.curves import Curves, curves_of
from ringlight.view.page import Page
from ringlight.view.subject import Subject, subject
from ringlight.view.viewer import Trained, Viewer, first_wishes
from ringlight.view.wishes import Wishes

WAIT_SECONDS = 0.1
"""While training pauses, until it is looked whether a signal has come."""

ALONE_SECONDS = 60.0
"""A training that was paused goes on where no browser has been open for so long: nobody could tell it to."""

MOST_LOSSES = 200
"""Points of the curve of the loss."""

MakePage = Callable[[Subject, Wishes], Page]


class LiveRun:
    """Looks at a ``session`` after each step, as :class:`ringlight.runs.watch.Watch` does."""

    def __init__(self, session: Session, make_page: MakePage):
        self.session = session
        training, scene = session.training, session.scene
        model = training.model
        about = subject(
            f"{session.record.preset} on {scene.name}",
            {session.record.preset: (model, scene.background_color)},
            [],
            scene,
            session.folder.path,
            session.folder.path,
        )
        self._losses = LossCurve(training.steps)
        self.wishes = first_wishes(about)
        trained = Trained(
            lambda: training.step, self._facts, lambda: {session.record.preset: self._curves()}, self._save
        )
        self.viewer = Viewer(about, make_page(about, self.wishes), self.wishes, trained)
        self._is_over = False

    def see(self, progress: Progress, stopping: Sequence[int]) -> str | None:
        """After a step; returns when training shall go on, or ``stopping`` fills. A sentence where the viewer has
        failed: then it is closed, and the run goes on."""
        if self._is_over:
            return None
        try:
            self._losses.note(progress)
            self.viewer.turn()
            self._wait_while_paused(stopping)
        except Exception as error:  # of whatever kind: the run is worth more than the look
            self.close()
            reason = " ".join(str(error).split()) or type(error).__name__
            return f"the viewer has failed ({reason}); training goes on without it"
        return None

    def close(self) -> None:
        """End the server; what is trained stays as it is."""
        if not self._is_over:
            self._is_over = True
            with suppress(Exception):  # it has failed already, perhaps
                self.viewer.close()

    def _wait_while_paused(self, stopping: Sequence[int]) -> None:
        alone = 0.0
        while self.viewer.is_paused and not stopping:
            self.wishes.changed.clear()
            if not self.viewer.turn():
                self.wishes.changed.wait(WAIT_SECONDS)
            alone = 0.0 if self.wishes.browsers else alone + WAIT_SECONDS
            if alone > ALONE_SECONDS:
                self.viewer.is_paused = False

    def _save(self) -> str:
        self.session.save()
        return f"saved after step {self.session.training.step}: checkpoint and model, in {self.session.folder.path}"

    def _facts(self) -> str:
        training, points = self.session.training, self.session.history.points
        decibels = f", {points[-1].psnr:.2f} dB" if points else ""
        return f"step {training.step:,} of {training.steps:,}{decibels}, {training.model.counted()}"

    def _curves(self) -> Curves:
        """Its loss is finer than that of the points."""
        steps, values = tuple(self._losses.steps), tuple(self._losses.values)
        return replace(curves_of(self.session.history.points), loss_steps=steps, loss=values)


class LossCurve:
    """Means of the loss over equally many steps, MOST_LOSSES of them at most."""

    def __init__(self, steps: int):
        self.every = -(-steps // MOST_LOSSES)
        self.steps: list[int] = []
        self.values: list[float] = []
        self._sum, self._count, self._last = 0.0, 0, 0

    def note(self, progress: Progress) -> None:
        """One step."""
        if progress.step <= self._last:  # the training went back
            kept = [pair for pair in zip(self.steps, self.values, strict=True) if pair[0] < progress.step]
            self.steps, self.values = [step for step, _ in kept], [value for _, value in kept]
            self._sum, self._count = 0.0, 0
        self._last = progress.step
        if progress.fault is None:
            self._sum += progress.loss
            self._count += 1
        if progress.step % self.every == 0 and self._count:
            self.steps.append(progress.step)
            self.values.append(self._sum / self._count)
            self._sum, self._count = 0.0, 0
