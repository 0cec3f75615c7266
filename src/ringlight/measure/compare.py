"""Runs side by side: one table and one contact sheet, from what the run folders hold, without models or data sets."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from ringlight.core.command_line import command
from ringlight.errors import RunError
from ringlight.measure.contact_sheet import SheetColumn, contact_sheet
from ringlight.measure.lpips_notes import stored_lpips_notes
from ringlight.measure.picture_names import RENDERS, TRUTHS
from ringlight.measure.pictures import PictureFolder, same_picture
from ringlight.measure.report import Report, read_report
from ringlight.measure.sheet_layout import PAPER
from ringlight.measure.table import ResultsTable

MUST_AGREE = ("split", "background", "resolution")
"""Fields of the report in which runs of one scene must agree for their measures to compare."""


@dataclass(frozen=True)
class Comparison:
    """``sheet`` is None where no run has pictures; ``notes`` say what is not shown, and the remedy."""

    table: ResultsTable
    sheet: Image.Image | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ComparedRun:
    """A run folder and the report in it."""

    folder: Path
    report: Report

    def pictures(self, kind: Path) -> PictureFolder:
        """Of its test views: ``RENDERS`` or ``TRUTHS``."""
        return PictureFolder(self.folder / kind, [image.name for image in self.report.images])


def compare(runs: Sequence[str | Path], views: int = 3) -> Comparison:
    """Read run folders (``report.json``, ``images/``) and hold them against each other, scene by scene.

    The first run is the one that others are compared with. A folder that is named twice counts once. ``views`` is the
    number of test views of each scene on the sheet; with 0 there is none.

    Raises:
        RunError: no runs, a report is missing or damaged, or two runs of a scene have different test views.
    """
    # The first mention decides the place: the first run named stays the baseline.
    folders = list({folder.resolve(): folder for folder in map(Path, runs)}.values())
    if not folders:
        raise RunError("no runs to compare; give the folders that 'ringlight train' wrote")
    loaded = [ComparedRun(folder, read_report(folder)) for folder in folders]
    scenes: dict[str, list[ComparedRun]] = {}
    for run in loaded:
        scenes.setdefault(run.report.scene, []).append(run)
    for together in scenes.values():
        for other in together[1:]:
            refuse_other_views(together[0], other)
    labels = {run.folder: label for together in scenes.values() for run, label in labelled(together)}
    table = ResultsTable(
        [(labels[run.folder], run.report) for run in loaded],
        baseline=labels[loaded[0].folder],
        lpips_notes=stored_lpips_notes([run.report for run in loaded]),
    )
    sheets = [_sheet(scene, together, labels, views) for scene, together in scenes.items()] if views else []
    shown = [run for run in loaded if run.report.images]
    bare = [run.folder for run in shown if not (run.pictures(RENDERS) and run.pictures(TRUTHS))]
    notes = tuple(f"{folder} has no pictures; make them with: {command('eval', folder)}" for folder in bare)
    return Comparison(table, _stacked([sheet for sheet in sheets if sheet]), notes)


def labelled(together: list[ComparedRun]) -> list[tuple[ComparedRun, str]]:
    """The runs of one scene with the shortest names that tell them apart: preset, else folder, else path."""
    candidates = [
        [run.report.preset for run in together],
        [_preset_and_folder(run) for run in together],
        [str(run.folder.resolve()) for run in together],
    ]
    chosen = next(names for names in candidates if max(Counter(names).values()) == 1)
    return list(zip(together, chosen, strict=True))


def _preset_and_folder(run: ComparedRun) -> str:
    preset, folder = run.report.preset, run.folder.resolve().name
    return preset if folder == preset else f"{preset} {folder}"


def refuse_other_views(first: ComparedRun, other: ComparedRun) -> None:
    """Raise RunError where two runs of a scene were measured on different test views."""
    remedy = "evaluate both with the same scene options"
    for field in MUST_AGREE:
        ours, theirs = getattr(first.report, field), getattr(other.report, field)
        if ours != theirs:
            reason = f"{field} ({ours} and {theirs})"
            raise RunError(f"{first.folder} and {other.folder} differ in the {reason} of their test views; {remedy}")
    if {image.name for image in first.report.images} != {image.name for image in other.report.images}:
        raise RunError(f"{first.folder} and {other.folder} were measured on different test views; {remedy}")
    ours, theirs = first.pictures(TRUTHS).paths, other.pictures(TRUTHS).paths
    for view in ours.keys() & theirs.keys():
        if not same_picture(ours[view], theirs[view]):
            raise RunError(f"{ours[view]} and {theirs[view]} are different photographs; {remedy}")


def _sheet(scene: str, together: list[ComparedRun], labels: dict[Path, str], views: int) -> Image.Image | None:
    shown = [run for run in together if run.pictures(RENDERS) and run.pictures(TRUTHS)]
    if not shown:
        return None
    columns = [SheetColumn(labels[run.folder], run.pictures(RENDERS)) for run in shown]
    return contact_sheet(columns, shown[0].pictures(TRUTHS), views, title=scene)


def _stacked(sheets: list[Image.Image]) -> Image.Image | None:
    """One sheet below the other."""
    if len(sheets) < 2:
        return sheets[0] if sheets else None
    whole = Image.new("RGB", (max(s.width for s in sheets), sum(s.height for s in sheets)), PAPER)
    top = 0
    for sheet in sheets:
        whole.paste(sheet, (0, top))
        top += sheet.height
    return whole
