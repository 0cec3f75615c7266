"""What a run folder still tells: its report, its record, its curve; what is missing or damaged becomes a sentence."""

from dataclasses import dataclass
from pathlib import Path

from ringlight.errors import RunError
from ringlight.measure.report import REPORT_NAME, CurvePoint, Report, folders_with, read_report
from ringlight.runs.curves import curve_so_far
from ringlight.runs.folder import RunFolder
from ringlight.runs.going_on import resuming
from ringlight.runs.record import RECORD_NAME, RunRecord


@dataclass(frozen=True)
class GatheredRun:
    """None: missing or damaged. ``troubles`` say this, and that a run has steps to go, a sentence each. Without a
    report the ``curve`` is that of the newest checkpoint."""

    folder: Path
    report: Report | None
    record: RunRecord | None
    curve: tuple[CurvePoint, ...]
    troubles: tuple[str, ...]

    @property
    def scene(self) -> str:
        """The name under which runs stand side by side."""
        if self.report is not None:
            return self.report.scene
        return self.record.scene.name if self.record else self.folder.resolve().name

    @property
    def preset(self) -> str:
        """What was asked for."""
        if self.report is not None:
            return self.report.preset
        return self.record.preset if self.record else self.folder.resolve().name


def gathered(folder: Path) -> GatheredRun:
    """All that is known of a run. Raises RunError for a folder that holds none."""
    run = RunFolder.open(folder)
    if not (run.recorded or run.report.is_file()):
        inside = folders_with(REPORT_NAME, folder) or folders_with(RECORD_NAME, folder)
        remedy = f"name the runs inside it: {inside}" if inside else "give a folder that 'ringlight train' wrote"
        raise RunError(f"{folder}: holds no run; {remedy}")
    troubles: list[str] = []
    record = report = None
    try:
        record = RunRecord.read(folder)
    except RunError as error:
        troubles.append(str(error))
    try:
        if run.report.is_file():
            report = read_report(folder)
    except RunError as error:
        troubles.append(str(error))
    curve = report.curve if report else tuple(curve_so_far(run))
    if report is None and not run.report.is_file():
        troubles.append(_unfinished(folder, record, curve))
    elif report and record and report.iterations is not None and report.iterations < record.steps:
        measured = f"{folder}: was measured at step {report.iterations:,} of {record.steps:,}"
        troubles.append(f"{measured}; go on with: {resuming(folder, record)}")
    return GatheredRun(folder, report, record, curve, tuple(troubles))


def _unfinished(folder: Path, record: RunRecord | None, curve: tuple[CurvePoint, ...]) -> str:
    planned = f" of {record.steps:,}" if record else ""
    reached = f"its last checkpoint's curve ends at step {curve[-1].step:,}{planned}" if curve else "it has no curve"
    told = f"{folder}: has no {REPORT_NAME}, so there are neither numbers nor pictures; {reached}"
    # Without its record no run goes on.
    return f"{told}; go on with: {resuming(folder, record)}" if record else told
