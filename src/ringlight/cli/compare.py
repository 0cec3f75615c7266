"""``ringlight compare RUN RUN ...``: several runs in one table and one contact sheet."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.flags import flags_in
from ringlight.cli.parse import parse, refuse
from ringlight.cli.stages import stages
from ringlight.errors import RecipeError
from ringlight.files.atomic import refuse_existing

if TYPE_CHECKING:
    from ringlight.measure.compare import Comparison


@dataclass(frozen=True)
class CompareArguments:
    """Runs side by side: one table, the settings in which runs of one method differ, and with --sheet one picture with
    the views on which they differ most.

    Reads what the run folders hold (report.json, images/), so neither models nor photographs are needed.
    """

    runs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="RUN [RUN ...]", help_behavior_hint="(required)")
    ]
    """Folders that train or eval --out wrote."""
    baseline: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None
    """The run with which the others are compared; by default the first."""
    views: int = 3
    """Test views on the sheet."""
    sheet: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Write the contact sheet, one picture with the views, to this file."""
    curves: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Write how the trainings went to this file: training PSNR over steps and seconds, size over steps."""
    overwrite: bool = False
    """Replace --sheet and --curves if they exist."""
    markdown: bool = False
    """Print the table as markdown, with all columns."""
    json: bool = False
    """Print the reports as JSON."""


def main(arguments: list[str]) -> int:
    """Compare; returns the exit code."""
    asked = parse(CompareArguments, "compare", arguments)
    if not asked.runs:
        refuse("compare", "no runs are named; give the folders that 'ringlight train' wrote")
    if asked.json and asked.markdown:
        refuse("compare", "--json and --markdown cannot both be printed; choose one")
    # Refused before anything is read.
    if asked.views < 1:
        raise RecipeError(f"--views is {asked.views}; give at least 1")
    if asked.sheet is None and "--views" in flags_in(arguments):
        raise RecipeError("--views is of the sheet; give --sheet FILE.png with it")
    for file in filter(None, (asked.sheet, asked.curves)):
        refuse_existing(file, asked.overwrite)
    with stages(quiet=not sys.stderr.isatty()) as line:
        line("reading reports and pictures")
        from ringlight.measure.compare import compare
        from ringlight.runs.sheet import write_sheet

        comparison = compare(_ordered(asked), asked.views if asked.sheet else 0)
        path = asked.sheet if comparison.sheet is not None else None
        if comparison.sheet is not None and path is not None:
            write_sheet(comparison.sheet, path)
        if asked.curves is not None:
            from ringlight.measure.training_curves import curves_picture

            write_sheet(curves_picture(comparison.table.runs), asked.curves)
    _print(asked, comparison, path)
    return 0


def _ordered(asked: CompareArguments) -> list[Path]:
    """The baseline first: the comparison holds the others against the first."""
    if asked.baseline is None:
        return list(asked.runs)
    return [asked.baseline, *(run for run in asked.runs if run.resolve() != asked.baseline.resolve())]


def _print(asked: CompareArguments, comparison: "Comparison", sheet: Path | None) -> None:
    from ringlight.cli.console import Screen
    from ringlight.measure.differing_settings import differing_settings
    from ringlight.measure.json_record import to_json

    table = comparison.table
    if asked.json:
        runs = [{"label": label, "report": report} for label, report in table.runs]
        written = str(sheet) if sheet else None
        differing = differing_settings(table.runs)
        record = {"baseline": table.baseline, "runs": runs, "sheet": written, "notes": comparison.notes}
        record |= {"differing_settings": differing}
        sys.stdout.write(to_json(record))
        return
    if asked.markdown:
        sys.stdout.write(table.markdown())
    else:
        Screen().print(table)
    sys.stderr.write("".join(f"{note}\n" for note in comparison.notes))
    if sheet is not None:
        sys.stderr.write(f"side by side: {sheet}\n")
    if asked.curves is not None:
        sys.stderr.write(f"how the trainings went: {asked.curves}\n")
    if asked.sheet is None:
        sys.stderr.write("the pictures side by side: add --sheet FILE.png\n")
