"""Processor time to sample the trains of putt and go back, by each way: python benchmarks/tensor_train_sampling.py

One thread; ranks of the paper. Points lie in a shell, as those that are shown do.
"""

import sys
import time
from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.volume.tensor_train_field import TensorTrain
from ringlight.volume.tt_sampling import from_blocks, from_grid, from_points

RANKS = {1: 200, 27: 280}
POINTS = {1: 400_000, 27: 100_000}
TIMES = 2
LARGEST_DENSE = {1: 8, 27: 7}
"""Levels up to which the whole grid is contracted: of appearance, 256 cubed would take 1.8 GB."""


def shell(count: int) -> Tensor:
    """Points near a sphere."""
    drawn = torch.Generator().manual_seed(0)
    radii = 0.35 + 0.02 * torch.rand(count, 1, generator=drawn)
    return 0.5 + radii * normalize(torch.randn(count, 3, generator=drawn))


def milliseconds(way: Callable[[], Tensor], leaves: list[Tensor]) -> int:
    """Of values and gradients, the least of a few times."""
    spent = []
    for _ in range(TIMES):
        begin = time.process_time()
        values = way()
        torch.autograd.grad(values, leaves, values.detach())
        spent.append(time.process_time() - begin)
    return round(1000 * min(spent))


def main() -> None:
    """Print a line for each payload and resolution."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    for payload, rank in RANKS.items():
        points = shell(POINTS[payload])
        for levels in range(4, 9):
            train = TensorTrain(payload, levels, levels, rank, torch.Generator().manual_seed(0))
            cores, half = train.reached, levels // 2
            ways = {"points": partial(from_points, cores, points, half)}
            if payload == 1 or levels < 8:
                ways["blocks"] = partial(from_blocks, cores, points, half)
            if levels <= LARGEST_DENSE[payload]:
                ways["grid"] = partial(from_grid, cores, points)
            spent = {name: milliseconds(way, cores) for name, way in ways.items()}
            sys.stdout.write(f"payload {payload}, {2**levels} cubed, {len(points):,} points: {spent} ms\n")


if __name__ == "__main__":
    main()
