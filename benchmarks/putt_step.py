"""Processor time of one step of putt at each resolution, and of what comes now and then: python benchmarks/putt_step.py

One thread; the settings of a run by default, so ranks of the paper. The scene is made up: a ball, seen by 4,096 rays
from all sides.
"""

import itertools
import resource
import sys
import time
from collections.abc import Callable
from functools import partial

import torch
from volume_workload import batch, own_peak, step_times

from ringlight import _kernels
from ringlight.core.want import Want
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.regularizers.appearance_variation import EVERY
from ringlight.fit.strategies.scaled_steps import RENEWED_EVERY
from ringlight.methods.putt import PuttRecipe
from ringlight.volume.emptying import find_empty
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


def seconds_of(work: Callable[[], object]) -> float:
    """Of the processor."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def main() -> None:
    """Print a line for each resolution."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    model, looked_at, recipe = ball(), batch(), PuttRecipe()
    model.gradient_share = recipe.gradient_share
    smooth = recipe.terms(model, 0)["tv_appearance"]
    for levels, begins in zip(range(FIRST_LEVELS, LAST_LEVELS + 1), (0, *recipe.refined), strict=False):
        doubling = seconds_of(partial(model.refine, 8.0**levels))
        find_empty(model)
        optimizer, shown = Optimizer(model, recipe.groups(), recipe.steps), model.predict(looked_at, Want.EXACT)
        (scaled,) = recipe.stepped_by(optimizer, model)
        scaled.update(begins, model, optimizer, shown)
        times = step_times(model, looked_at, optimizer, TIMES)
        scaling = seconds_of(partial(scaled.update, begins, model, optimizer, shown))
        smoothing = seconds_of(partial(smooth.term, 0, model, shown))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        sys.stdout.write(
            f"{2**levels} cubed: {doubling:.1f} s to double; {times} ms; {1e3 * smoothing:.0f} ms for smoothness, each "
            f"{EVERY}th step; {1e3 * scaling:.0f} ms to scale steps anew, each {RENEWED_EVERY}th; {memory:,.0f} MB at "
            "most so far\n"
        )
        sys.stdout.flush()
    sys.stdout.write(own_peak())


if __name__ == "__main__":
    main()
