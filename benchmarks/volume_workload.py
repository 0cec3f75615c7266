"""What benchmarks of volumes step on: 4,096 rays from all sides, towards a ball that each makes of its own."""

import itertools
import time

import torch

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch, Rays
from ringlight.fit.optimizer import Optimizer
from ringlight.measure.speed import peak_gflops
from ringlight.volume.model import VolumeModel

RAYS = 4096


def batch() -> RayBatch:
    """Rays towards the ball, and beside it."""
    drawn = torch.Generator().manual_seed(0)
    origins = 3 * normalize(torch.randn(RAYS, 3, generator=drawn))
    directions = normalize(-origins + 0.35 * torch.randn(RAYS, 3, generator=drawn))
    rays = Rays(origins, directions, torch.rand(RAYS, generator=drawn))
    return RayBatch(rays, torch.rand(RAYS, 3, generator=drawn), torch.ones(3))


def step_times(model: VolumeModel, looked_at: RayBatch, optimizer: Optimizer, times: int) -> list[int]:
    """Milliseconds of forward, backward, Adam, and all: the least of so many steps each."""
    steps = []
    for number in range(1, times + 1):
        ends = [time.process_time()]
        shown = model.predict(looked_at, Want.GRADIENTS)
        ends.append(time.process_time())
        gradients = shown.backward((shown.color - looked_at.colors) * (2 / shown.color.numel()), {})
        ends.append(time.process_time())
        optimizer.step(number, gradients)
        ends.append(time.process_time())
        steps.append([1000 * (b - a) for a, b in [*itertools.pairwise(ends), (ends[0], ends[-1])]])
    return [round(min(each)) for each in zip(*steps, strict=True)]


def own_peak() -> str:
    """A line on the machine, measured now."""
    return f"float32 matrix products here: {peak_gflops():.0f} GFLOP/s on {_kernels.isa()}\n"
