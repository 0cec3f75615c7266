"""Processor time of one step of putt at each resolution, and of each doubling: python benchmarks/putt_step.py

One thread; ranks of the paper. The scene is made up: a ball, seen by 4,096 rays from all sides.
"""

import itertools
import resource
import sys
import time

import torch
from volume_workload import batch, step_times

from ringlight import _kernels
from ringlight.fit.optimizer import Optimizer
from ringlight.methods.putt import PuttRecipe
from ringlight.volume.model import VolumeModel
from ringlight.volume.tensor_train import octant_path

FIRST_LEVELS, LAST_LEVELS, TIMES = 4, 8, 2


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


def main() -> None:
    """Print a line for each resolution."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    model, looked_at, recipe = ball(), batch(), PuttRecipe()
    model.gradient_share = recipe.gradient_share
    for levels in range(FIRST_LEVELS, LAST_LEVELS + 1):
        begin = time.process_time()
        model.refine(8.0**levels)
        doubling = time.process_time() - begin
        model.find_empty()
        times = step_times(model, looked_at, Optimizer(model, recipe.groups(), recipe.steps), TIMES)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(
            f"{2**levels} cubed: {doubling:.1f} s to double; {times} ms; {memory:,.0f} MB at most so far\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
