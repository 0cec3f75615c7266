"""Processor time of one step of putt at each resolution, and of each doubling: python benchmarks/putt_step.py

One thread; ranks of the paper. The scene is made up: a ball, seen by 4,096 rays from all sides.
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
from ringlight.methods.putt import PuttRecipe
from ringlight.volume.model import VolumeModel
from ringlight.volume.tensor_train import octant_path

FIRST_LEVELS, LAST_LEVELS, RAYS, TIMES = 4, 8, 4096, 2


def ball() -> VolumeModel:
    """Dense in the middle of its box, and empty beyond; a train of full ranks holds it exactly."""
    side = 1 << FIRST_LEVELS
    model = PuttRecipe().model_of(side, torch.tensor([[-1.0] * 3, [1.0] * 3]))
    nodes = torch.tensor(list(itertools.product(range(side), repeat=3)))
    entries = torch.empty(len(nodes))
    entries[octant_path(nodes, FIRST_LEVELS)] = (17 - 60 * (nodes / 8 - 1).square().sum(-1)).clamp_min(-7)
    cores = [torch.eye(8)[None], torch.eye(64).view(8, 8, 64), entries.view(64, 8, 8), torch.eye(8)[..., None]]
    for k, core in enumerate(cores):
        model.field.density_train.cores[k] = torch.nn.Parameter(core.contiguous())
    return model


def batch() -> RayBatch:
    """Rays towards the ball, and beside it."""
    drawn = torch.Generator().manual_seed(0)
    origins = 3 * normalize(torch.randn(RAYS, 3, generator=drawn))
    directions = normalize(-origins + 0.35 * torch.randn(RAYS, 3, generator=drawn))
    rays = Rays(origins, directions, torch.rand(RAYS, generator=drawn))
    return RayBatch(rays, torch.rand(RAYS, 3, generator=drawn), torch.ones(3))


def step_times(model: VolumeModel, looked_at: RayBatch) -> list[int]:
    """Milliseconds of forward, backward, Adam, and all: the least of a few steps each."""
    recipe = PuttRecipe()
    optimizer = Optimizer(model, recipe.groups(), recipe.steps)
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
    return [round(min(each)) for each in zip(*steps, strict=True)]


def main() -> None:
    """Print a line for each resolution."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    model, looked_at = ball(), batch()
    for levels in range(FIRST_LEVELS, LAST_LEVELS + 1):
        begin = time.process_time()
        model.refine(8.0**levels)
        doubling = time.process_time() - begin
        model.find_empty()
        times = step_times(model, looked_at)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(
            f"{2**levels} cubed: {doubling:.1f} s to double; {times} ms; {memory:,.0f} MB at most so far\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
