"""Speed of a rasterizer on the standard workload: the contract's call with gradients wanted, and its way back."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import torch

from ringlight import _kernels
from ringlight.bench.flops import Pairs
from ringlight.bench.record import Circumstances
from ringlight.bench.timing import SHORTEST_MS, TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, Workload, workload
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.randomness import generator
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.rasterize.cpu import CpuRasterizer
from ringlight.rasterize.cpu_job import Job, table_of

FORWARD, BACKWARD = "forward", "backward"
NATIVE = "cpu"
"""The rasterizer whose work is counted."""


@dataclass(frozen=True)
class Passes:
    """One rasterizer on one workload; ``both`` is the median of the sums, not the sum of the medians."""

    forward: Timing
    backward: Timing
    both: Timing


@dataclass(frozen=True)
class RasterRow:
    """One size. What is counted is None for another rasterizer than the CPU's."""

    size: Size
    visible: int
    """Gaussians that reach the image."""
    passes: Passes
    pairs: Pairs | None = None
    gflops: float | None = None
    """Operations of blending (``bench/flops.py``) over the time of both passes, fastest round."""
    stages: dict[str, float] = field(default_factory=dict)
    """Milliseconds of each in its fastest round, by the kernels' own clock: medians would show who else was busy."""


@dataclass(frozen=True)
class RasterBench:
    """What ``ringlight bench raster`` measured."""

    circumstances: Circumstances
    rasterizer: str
    rows: tuple[RasterRow, ...]


class OneView:
    """One view of the workload and its gradients: those of the stored parameters, activations included. The loss does
    not look at alpha."""

    def __init__(self, work: Workload, rasterize: Rasterizer, seed: int = 0):
        there = rasterize.device
        columns = {name: getattr(work.gaussians, name).to(there, copy=True) for name in GEOMETRY}
        self.gaussians = Gaussians.from_columns(columns)
        self.emission = Emission({"values": work.size.channels}, work.channels.to(there, copy=True))
        self.camera, self.rasterize = work.camera, rasterize
        self.background = torch.ones(work.size.channels)
        # A random dL/dimage of the size that a mean over pixels has; planar memory, as the losses give it.
        shape = (work.size.channels, work.size.pixels, work.size.pixels)
        upstream = torch.randn(shape, generator=generator(seed, 0, "image gradient")) / work.size.pixels**2
        self.upstream = upstream.to(there).permute(1, 2, 0)
        self.is_drawn = False

    def forward(self) -> None:
        self.raster = self.rasterize.draw(
            self.gaussians, self.emission, self.camera, self.background, want=Want.GRADIENTS
        )

    def backward(self) -> None:
        self.gradients = Gradients()
        self.raster.backward(self.upstream, None, self.gradients)
        self.is_drawn = True

    def stage_seconds(self) -> dict[str, float]:
        """Of both passes when they last ran, by the kernels' own clock; none before, for the rasterizer's is then of
        another view."""
        if not self.is_drawn or self.rasterize.name != NATIVE:
            return {}
        return dict(cast(CpuRasterizer, self.rasterize).spare[-1].workspace.stage_seconds)

    def pairs(self) -> Pairs:
        """What the compiled kernels evaluate and blend; slow."""
        workspace = _kernels.Workspace()
        job = Job(self.camera, self.background, RasterOptions(), len(self.gaussians))
        job.draw(workspace, table_of(self.gaussians, self.emission.channels, None))
        return Pairs(*workspace.count_pairs())


def bench_raster(sizes: Sequence[Size], rasterize: Rasterizer, budget: Budget, seed: int = 0) -> tuple[RasterRow, ...]:
    """Time every size."""
    return tuple(_row(size, rasterize, budget, seed) for size in sizes)


def _row(size: Size, rasterize: Rasterizer, budget: Budget, seed: int) -> RasterRow:
    view, stages = OneView(workload(size, seed), rasterize, seed), dict[str, float]()
    is_native = rasterize.name == NATIVE

    def read_clock() -> None:
        """Of the round before."""
        for name, seconds in view.stage_seconds().items():
            stages[name] = min(stages.get(name, math.inf), 1e3 * seconds)

    contestant = Contestant({FORWARD: view.forward, BACKWARD: view.backward}, prepare=read_clock)
    timings = interleaved({"": contestant}, budget)[""]
    read_clock()
    passes = Passes(timings[FORWARD], timings[BACKWARD], timings[TOTAL])
    visible = int(view.raster.footprint.visible.sum())
    if not is_native:
        return RasterRow(size, visible, passes)
    pairs, seconds = view.pairs(), max(passes.both.best_ms, SHORTEST_MS) / 1e3
    return RasterRow(size, visible, passes, pairs, pairs.flops(size.channels) / seconds / 1e9, stages)
