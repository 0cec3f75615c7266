"""Times the product's own parts while it trains: what a step calls is timed where it is called, and back."""

import copy
import dataclasses
import time
from collections.abc import Callable
from typing import Any

from ringlight.bench.timing import Timing, timed_of, timing_of, wait_for_gpu
from ringlight.fit.train import Training
from ringlight.models.splats import SplatModel

STAGES = (
    "photograph and loss",
    "colour forward",
    "raster forward",
    "shade forward",
    "prediction forward",
    "prediction backward",
    "shade backward",
    "raster backward",
    "colour backward",
    "adam",
    "strategies",
)
"""In the order of a step. Lazy colours, and tiles that are shaded as they are blended, are part of "raster forward".
What a model without Gaussians predicts is one stage."""


class Stopwatch:
    """Watches one training from its making on. The parts run as ever; only the clock is read around them."""

    def __init__(self, training: Training):
        self._seconds: dict[str, tuple[float, float]] = {}
        self._rounds: list[dict[str, tuple[float, float]]] = []
        self._watch(training.batches, "at", "photograph and loss")
        self._watch(training.loss, "compare", "photograph and loss")
        self._watch(training.optimizer, "step", "adam")
        for strategy in training.strategies:
            self._watch(strategy, "update", "strategies")
        splats = training.model.splats()
        if splats is None:
            self._watch(training.model, "predict", "prediction forward", "prediction backward")
        else:
            self._watch_splats(splats)

    def _watch_splats(self, model: SplatModel) -> None:
        self._watch(model.color, "emit", "colour forward", "colour backward")
        model.rasterize = copy.copy(model.rasterize)  # which other trainings may use too
        self._watch(model.rasterize, "draw", "raster forward", "raster backward")
        for way_there in ("shade", "tiles"):
            self._watch(model.shader, way_there, "shade forward", "shade backward")

    def end_round(self) -> None:
        """A step has been done."""
        self._rounds.append(self._seconds)
        self._seconds = {}

    def timings(self) -> dict[str, Timing]:
        """By stage, of the rounds that :func:`interleaved` times; a stage that took no time is left out."""
        timings = {}
        for stage in STAGES:
            found = [seconds.get(stage, (0.0, 0.0)) for seconds in timed_of(self._rounds)]
            if any(wall for wall, _ in found):
                timings[stage] = timing_of(found)
        return timings

    def _watch(self, owner: object, method: str, stage: str, stage_back: str | None = None) -> None:
        """Shadow a method of ``owner`` by one that is timed, and so the way back of the record that it returns."""
        usual = getattr(owner, method)

        def timed(*arguments: Any, **named: Any) -> Any:
            record = self._timed(stage, usual)(*arguments, **named)
            if stage_back is None or record is None:
                return record
            back = self._timed(stage_back, record.backward)
            if dataclasses.is_dataclass(record):
                return dataclasses.replace(record, backward=back)  # type: ignore[type-var]
            record.backward = back
            return record

        object.__setattr__(owner, method, timed)

    def _timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **named: Any) -> Any:
            wall, cpu = time.perf_counter(), time.process_time()
            result = function(*arguments, **named)
            wait_for_gpu()
            before = self._seconds.get(stage, (0.0, 0.0))
            spent = time.perf_counter() - wall, time.process_time() - cpu
            self._seconds[stage] = before[0] + spent[0], before[1] + spent[1]
            return result

        return timed
