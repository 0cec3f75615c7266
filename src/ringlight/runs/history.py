"""How a training went: PSNR and loss on training photographs, size and seconds, at a hundred of its steps at most."""

import json
import math
from collections.abc import Mapping

from ringlight.core.json_numbers import spelled
from ringlight.fit.train import Progress
from ringlight.measure.metrics import psnr
from ringlight.measure.report import CurvePoint

MOST_POINTS = 100
"""A run that is extended beyond keeps every other one, and so on: a curve of more is no finer on a picture."""

SAMPLED = 4
"""Photographs a point: PSNR jumps from one to the next, and each costs up to a tenth of a step."""


class History:
    """Hears every step of a run that is to have ``steps``, and keeps ``points``; goes on where a checkpoint was."""

    def __init__(self, steps: int):
        self.points: list[CurvePoint] = []
        self.every = math.ceil(steps / MOST_POINTS)
        self._sum, self._losses, self._count, self._last = 0.0, 0.0, 0, 0

    def note(self, progress: Progress, seconds: float, counted: int) -> None:
        """One step, after which training had taken ``seconds`` and the model had grown to ``counted``."""
        if progress.step <= self._last:  # the training went back
            self.points = [point for point in self.points if point.step < progress.step]
            self._begin_point()
        self._last = progress.step
        left = -progress.step % self.every
        if left < SAMPLED and progress.fault is None:
            self._sum += psnr(progress.prediction.color, progress.truth, progress.weights)
            self._losses += progress.loss
            self._count += 1
        if left == 0 and self._count:
            if self.points and self.points[-1].step % self.every:
                del self.points[-1]  # it was the newest when others were thinned
            mean, loss = self._sum / self._count, self._losses / self._count
            self.points.append(CurvePoint(progress.step, seconds, mean, counted, loss))
            self._begin_point()
            self._thin()

    def _begin_point(self) -> None:
        self._sum, self._losses, self._count = 0.0, 0.0, 0

    def _thin(self) -> None:
        while len(self.points) > MOST_POINTS:
            self.every *= 2
            *earlier, newest = self.points
            self.points = [*(point for point in earlier if point.step % self.every == 0), newest]

    def to_text(self) -> str:
        """For a checkpoint."""
        points = [[point.step, point.seconds, point.psnr, point.counted, point.loss] for point in self.points]
        kept = {"points": points, "sum": self._sum, "losses": self._losses, "count": self._count, "every": self.every}
        return json.dumps(spelled(kept), allow_nan=False)

    def go_on_from(self, facts: Mapping[str, str]) -> None:
        """From a checkpoint's facts; one of an earlier version has no history, or one that was not thinned. Raises
        ValueError for damage."""
        if "history" not in facts:
            return
        try:
            kept = json.loads(facts["history"])
            self.points = [_point(*row) for row in kept["points"]]
            self._sum, self._count = float(kept["sum"]), int(kept["count"])
            self._losses = float(kept.get("losses", 0.0))
            self.every = int(kept.get("every", self.every))
            if self.every < 1:
                raise ValueError(f"a point every {self.every} steps")
        except (KeyError, TypeError, ValueError, RecursionError, OverflowError) as error:
            raise ValueError(f"its history: {error}") from None
        self._thin()


def _point(step: object, seconds: object, mean: object, counted: object, loss: object = None) -> CurvePoint:
    """From a checkpoint; those of earlier versions know no loss. Raises TypeError or ValueError for damage."""
    numbers = [float(value) for value in (step, seconds, mean, counted)]  # type: ignore[arg-type]
    kept = None if loss is None else float(loss)  # type: ignore[arg-type]
    return CurvePoint(int(numbers[0]), numbers[1], numbers[2], int(numbers[3]), kept)
