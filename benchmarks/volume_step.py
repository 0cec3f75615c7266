"""Processor time of one step of tensorf, by the kernels and by the reference: python benchmarks/volume_step.py

One thread. The scene is made up: a ball in a grid of 300 cubed, seen by 4,096 rays from all sides.
"""

import itertools
import resource
import sys
import time

import torch

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch, Rays
from ringlight.fit.optimizer import Optimizer
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.volume import model as of_model

SIDE, RAYS, TIMES = 300, 4096, 5


def ball() -> of_model.VolumeModel:
    """Dense in the middle of its box; what is empty is known."""
    model = TensorfRecipe().model_of((SIDE, SIDE, SIDE), torch.tensor([[-1.0] * 3, [1.0] * 3]))
    with torch.no_grad():
        for plane in model.field.density_factors.planes:
            squares = torch.linspace(-1, 1, SIDE).square()
            radial = 3 - 14 * (squares[None, :, None] + squares[:, None, None])
            plane.copy_(radial.clamp(-4, 2).expand_as(plane))
        for line in model.field.density_factors.lines:
            line.fill_(0.5)
    model.find_empty()
    return model


def batch() -> RayBatch:
    """Rays towards the ball, and beside it."""
    drawn = torch.Generator().manual_seed(0)
    origins = 3 * normalize(torch.randn(RAYS, 3, generator=drawn))
    directions = normalize(-origins + 0.35 * torch.randn(RAYS, 3, generator=drawn))
    rays = Rays(origins, directions, torch.rand(RAYS, generator=drawn))
    return RayBatch(rays, torch.rand(RAYS, 3, generator=drawn), torch.ones(3))


def main() -> None:
    """Print milliseconds of forward, backward, Adam and all, the least of a few steps each."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    model, looked_at, recipe = ball(), batch(), TensorfRecipe()
    optimizer = Optimizer(model, recipe.groups(), recipe.steps)
    for way in ("kernels", "reference"):
        if way == "reference":
            of_model.runs_native = lambda *_: False
        steps = []
        for number in range(1, TIMES + 1):
            ends = [time.process_time()]
            shown = model.predict(looked_at, Want.GRADIENTS)
            ends.append(time.process_time())
            gradients = shown.backward((shown.color - looked_at.colors) * (2 / shown.color.numel()), {})
            ends.append(time.process_time())
            optimizer.step(number, gradients)
            ends.append(time.process_time())
            steps.append([1000 * (b - a) for a, b in [*itertools.pairwise(ends), (ends[0], ends[-1])]])
        least = [round(min(each)) for each in zip(*steps, strict=True)]
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(f"{way}: {least} ms, {memory:,.0f} MB at most so far\n")


if __name__ == "__main__":
    main()
