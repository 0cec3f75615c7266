"""Processor time of one step of tensorf, by the kernels and by the reference: python benchmarks/volume_step.py

One thread. The scene is made up: a ball in a grid of 300 cubed, seen by 4,096 rays from all sides.
"""

import resource
import sys

import torch
from volume_workload import batch, step_times

from ringlight import _kernels
from ringlight.fit.optimizer import Optimizer
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.volume import model as of_model

SIDE, TIMES = 300, 5


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


def main() -> None:
    """Print milliseconds of forward, backward, Adam and all, the least of a few steps each."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    model, looked_at, recipe = ball(), batch(), TensorfRecipe()
    model.gradient_share = recipe.gradient_share
    optimizer = Optimizer(model, recipe.groups(), recipe.steps)
    for way in ("kernels", "reference"):
        if way == "reference":
            of_model.runs_native = lambda *_: False
        least = step_times(model, looked_at, optimizer, TIMES)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(f"{way}: {least} ms, {memory:,.0f} MB at most so far\n")


if __name__ == "__main__":
    main()
