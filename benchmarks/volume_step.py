"""Processor time of one step of tensorf, by the kernels and by the reference: python benchmarks/volume_step.py [cp]

One thread. The scene is made up: a ball in a grid of 300 cubed, or of 500 cubed as three lines, seen by 4,096 rays from
all sides.
"""

import resource
import sys

import torch
from volume_workload import batch, own_peak, step_times

from ringlight import _kernels
from ringlight.fit.optimizer import Optimizer
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.volume import model as of_model
from ringlight.volume.emptying import find_empty
from ringlight.volume.factors import Decomposition

SIDES, TIMES = {"vm": 300, "cp": 500}, 5


def ball(kind: Decomposition) -> of_model.VolumeModel:
    """Dense in the middle of its box; what is empty is known."""
    side = SIDES[kind]
    model = TensorfRecipe(decomposition=kind).model_of((side, side, side), torch.tensor([[-1.0] * 3, [1.0] * 3]))
    squares, factors = torch.linspace(-1, 1, side).square(), model.field.density_factors
    with torch.no_grad():
        for plane in factors.planes:
            radial = 3 - 14 * (squares[None, :, None] + squares[:, None, None])
            plane.copy_(radial.clamp(-4, 2).expand_as(plane))
        along = torch.full_like(squares, 0.5) if kind == "vm" else (-6 * squares).exp()
        for line in factors.lines:
            line.copy_(along[:, None].expand_as(line))
    find_empty(model)
    return model


def main() -> None:
    """Print milliseconds of forward, backward, Adam and all, the least of a few steps each."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    kind: Decomposition = "cp" if "cp" in sys.argv[1:] else "vm"
    model, looked_at, recipe = ball(kind), batch(), TensorfRecipe(decomposition=kind)
    model.gradient_share = recipe.gradient_share
    optimizer = Optimizer(model, recipe.groups(), recipe.steps)
    for way in ("kernels", "reference"):
        if way == "reference":
            of_model.runs_native = lambda *_: False
        least = step_times(model, looked_at, optimizer, TIMES)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(f"{way}: {least} ms, {memory:,.0f} MB at most so far\n")
    sys.stdout.write(own_peak())


if __name__ == "__main__":
    main()
