"""Frames per second of a method's model on the standard workload, everything switched on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from ringlight.bench.record import Circumstances
from ringlight.bench.step import splats_of, subject_of_workload
from ringlight.bench.timing import SHORTEST_MS, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, workload_camera
from ringlight.core.want import Want
from ringlight.measure.speed import device_name
from ringlight.methods.recipe import Recipe
from ringlight.rasterize.contract import Rasterizer

VIEWS = 8
"""Cameras around the ball, one full turn."""

PASS = "pass"
"""All views, one after the other."""


@dataclass(frozen=True)
class FpsRow:
    """One method. Seconds per frame: the median over passes, the mean of the CPU, and the fastest pass; ``note`` says
    what was timed, and on what device."""

    method: str
    size: Size
    fps: float
    wall_seconds: float
    cpu_seconds: float
    best_seconds: float
    note: str


@dataclass(frozen=True)
class FpsBench:
    """What ``ringlight bench fps`` measured."""

    circumstances: Circumstances
    rasterizer: str
    rows: tuple[FpsRow, ...]


def bench_fps(
    recipes: Sequence[tuple[str, Recipe]], sizes: Sequence[Size], rasterize: Rasterizer, budget: Budget, seed: int = 0
) -> tuple[FpsRow, ...]:
    """Every method at every size, those of a size in turns; ``budget`` is each method's, of which a half goes to the
    pass before each that is timed."""
    return tuple(row for size in sizes for row in _rows(recipes, size, rasterize, budget, seed))


def _rows(
    recipes: Sequence[tuple[str, Recipe]], size: Size, rasterize: Rasterizer, budget: Budget, seed: int
) -> list[FpsRow]:
    contestants = {name: Contestant({PASS: _pass(name, recipe, size, rasterize, seed)}) for name, recipe in recipes}
    passes = Budget(budget.rounds, budget.seconds * len(contestants))
    timings = interleaved(contestants, passes)
    return [_row(name, size, timings[name][PASS], rasterize.device) for name in contestants]


def _pass(method: str, recipe: Recipe, size: Size, rasterize: Rasterizer, seed: int) -> Callable[[], None]:
    """What shows all views once."""
    training = subject_of_workload(method, recipe, size, rasterize, seed).training
    model, background = splats_of(training, method).eval(), torch.ones(3)
    for name in model.color.training_columns:  # a model file is without
        if name in model.columns:
            model.columns.pop(name)
    cameras = [workload_camera(size.pixels, turn_y=math.tau * view / VIEWS) for view in range(VIEWS)]

    def show() -> None:
        for camera in cameras:
            model.render(camera, background, Want.PICTURE)

    return show


def _row(method: str, size: Size, timing: Timing, device: torch.device) -> FpsRow:
    wall, cpu, best = (ms / 1e3 / VIEWS for ms in (timing.wall_ms, timing.cpu_ms, timing.best_ms))
    views = f"{VIEWS} views of {size.pixels}x{size.pixels}, one at a time"
    note = f"render call only, {views}, methods in turns, median over passes, on {device_name(device)}"
    return FpsRow(method, size, 1 / max(wall, SHORTEST_MS / 1e3), wall, cpu, best, note)
