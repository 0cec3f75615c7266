"""Speed of one Adam update of the whole table: our kernel beside torch's fused and foreach Adam, in turns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.record import Circumstances
from ringlight.bench.timing import SHORTEST_MS, Budget, Contestant, Timing, interleaved
from ringlight.core.randomness import generator
from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, Rate

WIDTHS = (3, 3, 4, 1, 3, 45)
"""Floats a row of the columns of ``3dgs``: centres, scales, rotations, opacities, constant and other harmonics."""

BYTES_PER_FLOAT = 28
"""Gradient, value and two moments are read, the last three written; four bytes each."""

MOST_GAUSSIANS = 5_000_000
GROUP = Adam(Rate.constant(1e-3))
KERNEL, FUSED, FOREACH = "kernel", "fused", "foreach"


@dataclass(frozen=True)
class AdamRow:
    """N Gaussians of 59 floats. ``ratio`` is torch's fused Adam over ours, of medians."""

    gaussians: int
    kernel: Timing
    fused: Timing
    foreach: Timing
    wall_ratio: float
    cpu_ratio: float
    gigabytes_per_second: float
    """Of the kernel's memory traffic in its fastest round; above the copy's where the table fits the caches."""


@dataclass(frozen=True)
class AdamBench:
    """What ``ringlight bench adam`` measured."""

    circumstances: Circumstances
    rows: tuple[AdamRow, ...]


def bench_adam(counts: Sequence[int], budget: Budget, seed: int = 0) -> tuple[AdamRow, ...]:
    """Time tables of these many Gaussians. Raises RecipeError for a number out of range."""
    wrong = [count for count in counts if not 1 <= count <= MOST_GAUSSIANS]
    if wrong:
        raise RecipeError(f"{wrong[0]} Gaussians cannot be updated; give 1 to {MOST_GAUSSIANS}")
    return tuple(_row(count, budget, seed) for count in counts)


def torch_step(columns: Sequence[Tensor], gradients: Sequence[Tensor], *, fused: bool) -> Callable[[], object]:
    """One update by torch, fused or foreach, of copies of the columns."""
    copies = [column.clone().requires_grad_() for column in columns]
    for copy, gradient in zip(copies, gradients, strict=True):
        copy.grad = gradient
    judge = torch.optim.Adam(
        copies, lr=GROUP.rate.start, betas=GROUP.betas, eps=GROUP.epsilon, fused=fused, foreach=not fused
    )
    return judge.step


class AdamKernel:
    """One update of copies of the columns, again and again."""

    def __init__(self, columns: Sequence[Tensor], gradients: Sequence[Tensor]):
        self._values, self._gradients = [column.clone() for column in columns], list(gradients)
        self._means, self._squares = ([torch.zeros_like(value) for value in self._values] for _ in range(2))
        # Far into a run, where both moments are warm.
        self._steps = [(GROUP.rate.at(0.5), *GROUP.betas, GROUP.epsilon, 1000) for _ in columns]

    def run(self) -> None:
        _kernels.adam(self._values, self._gradients, self._means, self._squares, self._steps)


def _row(count: int, budget: Budget, seed: int) -> AdamRow:
    draw = generator(seed, count, "adam")
    columns = [torch.randn(count, width, generator=draw) for width in WIDTHS]
    gradients = [torch.randn(count, width, generator=draw) for width in WIDTHS]
    contestants = {
        KERNEL: AdamKernel(columns, gradients).run,
        FUSED: torch_step(columns, gradients, fused=True),
        FOREACH: torch_step(columns, gradients, fused=False),
    }
    timings = interleaved({name: Contestant({name: step}) for name, step in contestants.items()}, budget)
    ours, theirs = timings[KERNEL][KERNEL], timings[FUSED][FUSED]
    traffic = BYTES_PER_FLOAT * sum(WIDTHS) * count
    return AdamRow(
        gaussians=count,
        kernel=ours,
        fused=theirs,
        foreach=timings[FOREACH][FOREACH],
        wall_ratio=theirs.wall_ms / max(ours.wall_ms, SHORTEST_MS),
        cpu_ratio=theirs.cpu_ms / max(ours.cpu_ms, SHORTEST_MS),
        gigabytes_per_second=traffic / max(ours.best_ms, SHORTEST_MS) / 1e6,
    )
