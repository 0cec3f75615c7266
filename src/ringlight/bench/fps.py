"""Frames per second of a method's model on the standard workload, everything switched on."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ringlight.bench.record import Circumstances
from ringlight.bench.step import subject_of_workload
from ringlight.bench.timing import Budget
from ringlight.bench.workload import Size, workload_camera
from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.measure.speed import frames_per_second
from ringlight.rasterize.contract import Rasterizer

VIEWS = 8
"""Cameras around the ball, one full turn."""


@dataclass(frozen=True)
class FpsRow:
    """One method. Seconds are medians over passes, per frame; ``note`` says what was timed, and on what device."""

    method: str
    size: Size
    fps: float
    wall_seconds: float
    cpu_seconds: float
    note: str


@dataclass(frozen=True)
class FpsBench:
    """What ``ringlight bench fps`` measured."""

    circumstances: Circumstances
    rasterizer: str
    rows: tuple[FpsRow, ...]


def bench_fps(
    recipes: Sequence[tuple[str, Any]], sizes: Sequence[Size], rasterize: Rasterizer, budget: Budget, seed: int = 0
) -> tuple[FpsRow, ...]:
    """Every method at every size, one after the other; ``budget`` bounds the passes of each."""
    return tuple(_row(name, recipe, size, rasterize, budget, seed) for size in sizes for name, recipe in recipes)


def _row(method: str, recipe: Any, size: Size, rasterize: Rasterizer, budget: Budget, seed: int) -> FpsRow:
    training = subject_of_workload(method, recipe, size, rasterize, seed).training
    model, background = training.model.eval(), training.batches.scene.background_color
    for name in model.color.training_columns:  # a model file is without
        if name in model.columns:
            model.columns.pop(name)

    def render(camera: Camera) -> Rendering:
        return model.picture(camera, background)

    cameras = [workload_camera(size.pixels, turn_y=math.tau * view / VIEWS) for view in range(VIEWS)]
    rate = frames_per_second(render, cameras, passes=budget.rounds, max_seconds=budget.seconds)
    return FpsRow(method, size, rate.fps, rate.wall_seconds, rate.cpu_seconds, rate.note)
