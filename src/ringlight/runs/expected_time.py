"""About how long runs will take that are not there yet, by those that are."""

from collections.abc import Sequence
from dataclasses import dataclass

from ringlight.measure.report import Report

CORE_SECONDS_A_STEP = 0.03
"""Where no run tells: 3,000 steps of README's table took 31 to 118 core seconds."""


@dataclass(frozen=True)
class Expected:
    """A run of so many ``steps`` of what is called ``name``; ``report`` is None before it is measured."""

    scene: str
    name: str
    steps: int
    report: Report | None
    is_missing: bool


def core_seconds(runs: Sequence[Expected]) -> tuple[float, bool]:
    """About what the missing runs will take, and whether any of ``runs`` told; all cores together.

    A run's rate is that of finished ones of its name and scene, else of its name, else of any.
    """
    told = [(run, run.report.core_seconds / run.steps) for run in runs if run.report and run.report.core_seconds]
    total = 0.0
    for missing in runs:
        if missing.is_missing:
            kin = [(run, rate) for run, rate in told if run.name == missing.name]
            same = [(run, rate) for run, rate in kin if run.scene == missing.scene]
            rates = [rate for _, rate in same or kin or told] or [CORE_SECONDS_A_STEP]
            total += missing.steps * sum(rates) / len(rates)
    return total, bool(told)
