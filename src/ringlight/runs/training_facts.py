"""What a model's file and its run folder know of its training: what a report says beside what pictures tell."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from ringlight.errors import ModelFileError, RunError
from ringlight.files.tensor_file import read_metadata
from ringlight.measure.lpips import Net
from ringlight.measure.machine import source_commit
from ringlight.measure.report import CurvePoint, GivenSetting, read_report
from ringlight.runs.changed_settings import settings_by_name
from ringlight.runs.folder import RunFolder
from ringlight.runs.history import History
from ringlight.runs.opened import Opened
from ringlight.runs.record import RunRecord

SECONDS = {
    "train_seconds": "wall_seconds",
    "train_cpu_seconds": "cpu_seconds",
    "saving_seconds": "saving_seconds",
    "choosing_cpu_seconds": "choosing_seconds",
}
"""What reports call a checkpoint's clocks."""


@dataclass(frozen=True)
class TrainingFacts:
    """What the pictures do not tell, field by field as in a ``Report``; None where it is not known, as for a model that
    was trained elsewhere."""

    preset: str
    method: str
    seed: int | None = None
    iterations: int | None = None
    planned: int | None = None
    settings: dict[str, GivenSetting] | None = None
    train_seconds: float | None = None
    train_cpu_seconds: float | None = None
    saving_seconds: float | None = None
    choosing_cpu_seconds: float | None = None
    peak_bytes: int | None = None
    training_bytes: dict[str, int] = field(default_factory=dict)
    collapses: tuple[str, ...] = ()
    bytes_file: int | None = None
    curve: tuple[CurvePoint, ...] = ()
    commit: str | None = field(default_factory=source_commit)
    """Of the code that trained, or else measures."""


def known_facts(opened: Opened) -> TrainingFacts:
    """What a model's file and its run folder still know of its training; a damaged report or checkpoint is skipped."""
    header, run = opened.stored.header, opened.run
    planned, size = header.recipe.get("steps"), opened.file.stat().st_size
    facts = TrainingFacts(header.preset, header.method, bytes_file=size)
    if header.step:  # a model that was imported was trained elsewhere
        longest = max(planned, header.step) if isinstance(planned, int) else None
        facts = replace(facts, iterations=header.step, planned=longest)
    if run is None:
        return facts
    record = RunRecord.read(run.path)
    facts = replace(facts, seed=record.seed, planned=record.steps, settings=settings_by_name(record))
    return replace(facts, **_costs(run, header.step))


def _costs(run: RunFolder, step: int) -> dict[str, Any]:
    """What training took until ``step``, from the report, else from the checkpoint that is of it."""
    with suppress(RunError):
        report = read_report(run.path)
        if report.iterations == step:
            kept = (*SECONDS, "peak_bytes", "training_bytes", "collapses", "curve", "commit", "settings")
            return {name: getattr(report, name) for name in kept}
    for checkpoint in run.checkpoints:
        with suppress(ModelFileError, KeyError, ValueError):
            stored = read_metadata(checkpoint)
            if stored.get("step", str(step)) == str(step):  # those of earlier versions do not say
                return _costs_in(stored)
    return {}


def _costs_in(checkpoint: Mapping[str, str]) -> dict[str, Any]:
    """Raises KeyError or ValueError for damage."""
    history = History(1)
    history.go_on_from(checkpoint)
    seconds = {name: float(checkpoint[kept]) for name, kept in SECONDS.items() if kept in checkpoint}
    commit = {"commit": checkpoint["commit"] or None} if "commit" in checkpoint else {}
    peak = int(checkpoint["peak_bytes"]) or None
    return {**seconds, **commit, "peak_bytes": peak, "curve": tuple(history.points)}


def measured_nets(run: RunFolder) -> tuple[Net, ...]:
    """The networks whose LPIPS a run's report has; none where it cannot be read."""
    with suppress(RunError):
        report = read_report(run.path)
        known: dict[Net, float | None] = {"alex": report.lpips_alex, "vgg": report.lpips_vgg}
        return tuple(net for net, value in known.items() if value is not None)
    return ()
