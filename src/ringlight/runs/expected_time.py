"""About how long runs will take that are not there yet, by those that are."""

from collections.abc import Sequence
from dataclasses import dataclass

from ringlight.measure.report import Report

CORE_SECONDS_A_STEP = {
    "3igs": 0.09,
    "gaussian-shader": 0.07,
    "ringlight-basis": 0.06,
    "ringlight-mirror": 0.05,
    "ringlight-paper": 0.13,
    "tensorf": 0.19,
    "putt": 1.1,
}
"""Where no run tells: medians of the runs that README's tables are made of, which spread by a factor of four."""

OF_OTHERS = 0.03
"""The same of all other methods."""


@dataclass(frozen=True)
class Expected:
    """A run of so many ``steps`` of what is called ``name``; ``report`` is None before it is measured."""

    scene: str
    name: str
    preset: str
    steps: int
    report: Report | None
    is_missing: bool


def core_seconds(runs: Sequence[Expected]) -> tuple[float, bool]:
    """About what the missing runs will take, and whether any of ``runs`` told; all cores together.

    A run's rate is that of finished ones of its name and scene, else of its name, else README's, in proportion to what
    the finished ones of other names took of theirs.
    """
    told = [(run, run.report.core_seconds / run.steps) for run in runs if run.report and run.report.core_seconds]
    others = [rate / usual(run.preset) for run, rate in told]
    here = sum(others) / len(others) if others else 1.0
    total = 0.0
    for missing in runs:
        if missing.is_missing:
            kin = [(run, rate) for run, rate in told if run.name == missing.name]
            same = [(run, rate) for run, rate in kin if run.scene == missing.scene]
            rates = [rate for _, rate in same or kin] or [here * usual(missing.preset)]
            total += missing.steps * sum(rates) / len(rates)
    return total, bool(told)


def usual(preset: str) -> float:
    """Core seconds a step of README's runs."""
    return CORE_SECONDS_A_STEP.get(preset, OF_OTHERS)
