"""Speed of the parts of a training step, each alone and at several sizes, in turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ringlight.bench.record import Circumstances
from ringlight.bench.step_parts import BACKWARD, FORWARD, PARTS
from ringlight.bench.timing import SHORTEST_MS, TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size
from ringlight.errors import RecipeError

OURS, SHOW = "ours", "show"
"""Names under which a part itself takes its turns."""


@dataclass(frozen=True)
class Beside:
    """The same work done otherwise, or more of it where ``step_parts.py`` says so, in turns with the part. Ratios are
    its time over the part's."""

    name: str
    both: Timing
    wall_ratio: float
    cpu_ratio: float


@dataclass(frozen=True)
class PartRow:
    """One part at one size. ``show`` wants no gradient, as in rendering; ``both`` is a training step's. None stands for
    what the part does not have: a loss gives value and gradient in one pass."""

    part: str
    size: Size
    items: int
    """Gaussians, or pixels, that the part works on."""
    show: Timing | None
    forward: Timing | None
    backward: Timing | None
    both: Timing
    beside: tuple[Beside, ...]
    largest_difference: float | None
    """Between the part's result and that of its reference, as a share of the largest value."""

    @property
    def nanoseconds_each(self) -> float:
        """Processor time of ``both`` for one Gaussian or pixel."""
        return 1e6 * self.both.cpu_ms / self.items


@dataclass(frozen=True)
class PartsBench:
    """What ``ringlight bench parts`` measured."""

    circumstances: Circumstances
    rows: tuple[PartRow, ...]


def bench_parts(
    names: Sequence[str], sizes: Sequence[Size], budget: Budget, seed: int, device: torch.device
) -> tuple[PartRow, ...]:
    """Time the named parts at each size; all parts of a size take turns, and ``budget`` is each one's.

    Raises RecipeError for an unknown part.
    """
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        raise RecipeError(f"no part is called {unknown[0]!r}; known: {', '.join(PARTS)}")
    return tuple(row for size in sizes for row in _rows(names, size, budget, seed, device))


def _rows(names: Sequence[str], size: Size, budget: Budget, seed: int, device: torch.device) -> list[PartRow]:
    parts = {name: PARTS[name](size, seed, device) for name in names}
    contestants = {}
    for name, part in parts.items():
        shown = {SHOW: {SHOW: part.show}} if part.show else {}
        for who, stages in {OURS: part.stages, **shown, **part.beside}.items():
            contestants[name, who] = Contestant(stages)
    timings = interleaved(contestants, Budget(budget.rounds, budget.seconds * len(parts)))

    def beside(name: str, who: str) -> Beside:
        ours, theirs = timings[name, OURS][TOTAL], timings[name, who][TOTAL]
        ratios = (theirs.wall_ms / max(ours.wall_ms, SHORTEST_MS), theirs.cpu_ms / max(ours.cpu_ms, SHORTEST_MS))
        return Beside(who, theirs, *ratios)

    return [
        PartRow(
            part=name,
            size=size,
            items=part.items,
            show=timings[name, SHOW][SHOW] if part.show else None,
            forward=timings[name, OURS].get(FORWARD),
            backward=timings[name, OURS].get(BACKWARD),
            both=timings[name, OURS][TOTAL],
            beside=tuple(beside(name, who) for who in part.beside),
            largest_difference=_difference(*part.results()) if part.results else None,
        )
        for name, part in parts.items()
    ]


def _difference(ours: Tensor, theirs: Tensor) -> float:
    return float((ours - theirs).abs().max() / theirs.abs().max())
