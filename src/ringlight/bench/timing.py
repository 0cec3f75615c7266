"""Interleaved timing: contestants take turns, so that a busy moment of the machine falls on all of them alike."""

import gc
import sys
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import fmean, median
from typing import TypeVar

WARMUP_ROUNDS = 2
"""The first rounds allocate memory and fill caches."""

RUNS_A_TURN = 2
"""The first wakes a contestant's threads, sends another's to sleep, and fills the caches, as in training; the last is
timed."""

SHORTEST_MS = 1e-6
"""A nanosecond: no ratio divides by zero where a clock is coarse."""

TOTAL = "total"
"""Name under which the sum over all stages of a round is reported."""


@dataclass(frozen=True)
class Timing:
    """Milliseconds. ``wall_ms`` is the median over rounds, ``best_ms`` the fastest; ``cpu_ms``, summed over threads, is
    the mean: the system books another core's time only when its clock ticks, so that no single round has its own."""

    wall_ms: float
    cpu_ms: float
    best_ms: float


@dataclass(frozen=True)
class Contestant:
    """Stages run and timed one after the other; ``prepare`` runs before each round, off the clock."""

    stages: Mapping[str, Callable[[], object]]
    prepare: Callable[[], object] = field(default=lambda: None)


@dataclass(frozen=True)
class Budget:
    """Rounds wanted, and the seconds after which no further round begins (one is always timed)."""

    rounds: int
    seconds: float


Name = TypeVar("Name", bound=Hashable)
Run = TypeVar("Run")


def interleaved(contestants: Mapping[Name, Contestant], budget: Budget) -> dict[Name, dict[str, Timing]]:
    """Time every stage of every contestant, in turns; each also gets :data:`TOTAL`, the sum of its stages."""
    records: dict[Name, list[dict[str, tuple[float, float]]]] = {name: [] for name in contestants}
    for _ in range(WARMUP_ROUNDS):
        for contestant in contestants.values():
            _round(contestant)
    begun = time.perf_counter()
    collecting = gc.isenabled()
    # A collection of garbage would be charged to whoever happens to run.
    gc.disable()
    try:
        for index in range(max(budget.rounds, 1)):
            if index and time.perf_counter() - begun > budget.seconds:
                break
            for name, contestant in contestants.items():
                records[name].append([_round(contestant) for _ in range(RUNS_A_TURN)][-1])
    finally:
        if collecting:
            gc.enable()
    return {
        name: {stage: timing_of([each[stage] for each in rounds]) for stage in rounds[0]}
        for name, rounds in records.items()
    }


def timed_of(runs: Sequence[Run]) -> Sequence[Run]:
    """Of what a contestant noted at each of its runs in :func:`interleaved`, in their order, what is of timed ones."""
    return runs[WARMUP_ROUNDS + RUNS_A_TURN - 1 :: RUNS_A_TURN]


def _round(contestant: Contestant) -> dict[str, tuple[float, float]]:
    """Wall and CPU seconds of each stage and of all, once."""
    contestant.prepare()
    wait_for_gpu()
    marks = [(time.perf_counter(), time.process_time())]
    for stage in contestant.stages.values():
        stage()
        wait_for_gpu()
        marks.append((time.perf_counter(), time.process_time()))
    spans = zip((*contestant.stages, TOTAL), (*pairwise(marks), (marks[0], marks[-1])), strict=True)
    return {stage: (after[0] - before[0], after[1] - before[1]) for stage, (before, after) in spans}


def wait_for_gpu() -> None:
    """A GPU works on after a call has returned: the clock is read when it has nothing left to do."""
    torch = sys.modules.get("torch")
    if torch is not None and torch.cuda.is_initialized():
        torch.cuda.synchronize()


def timing_of(seconds: Sequence[tuple[float, float]]) -> Timing:
    """Of wall and CPU seconds, a pair a round."""
    walls, cpus = zip(*seconds, strict=True)
    return Timing(1e3 * median(walls), 1e3 * fmean(cpus), 1e3 * min(walls))
