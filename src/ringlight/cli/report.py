"""``ringlight report RUN ... FILE.html``: one page about runs, which opens anywhere."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.parse import parse, refuse
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.core.words import MEGABYTE
from ringlight.errors import RecipeError
from ringlight.files.atomic import refuse_existing

if TYPE_CHECKING:
    from ringlight.pages.report.build import WrittenReport

PAGE = ".html"

MOST_VIEWS = 1000
"""Of each scene: their pictures fill the page's room long before, and each is read twice."""


@dataclass(frozen=True)
class ReportArguments:
    """One page about one or several runs: table, curves, test views with a curtain between photograph and picture,
    error maps, layers, settings, machine, and the commands that repeat them.

    The page is one file that loads nothing. A run that is unfinished or damaged is shown as far as it goes.
    """

    files: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="RUN [RUN ...] FILE.html", help_behavior_hint="(required)"),
    ]
    """Folders that train wrote, and last the page to write."""
    views: int = 6
    """Test views of each scene: a third of them the worst, a third the best. 0 for none."""
    no_layers: bool = False
    """Leave out what pictures are made of; no model is opened then."""
    overwrite: bool = False
    """Replace the page if it exists."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print as JSON what was written: the page, its bytes, the runs with their reports, what is missing."""


def main(arguments: list[str]) -> int:
    """Write the page; returns the exit code."""
    asked = parse(ReportArguments, "report", arguments)
    if not asked.files:
        refuse("report", "missing: RUN, FILE.html; give the folders that 'ringlight train' wrote, then the page")
    *runs, page = asked.files
    if page.suffix.lower() != PAGE:
        refuse("report", f"the last name is the page to write, and {str(page)!r} does not end in {PAGE}")
    if not runs:
        refuse("report", "no runs are named; give the folders that 'ringlight train' wrote, then the page")
    if not 0 <= asked.views <= MOST_VIEWS:
        raise RecipeError(f"--views is {asked.views}; give 0 for none, or up to {MOST_VIEWS:,}")
    check_threads(asked.threads)
    refuse_existing(page, asked.overwrite)
    with stages(quiet=not sys.stderr.isatty()) as line:
        line("reading runs")
        from ringlight.pages.report.build import write_report_page

        use_threads(asked.threads)
        written = write_report_page(runs, page, asked.views, not asked.no_layers)
    _print(asked, written)
    return 0


def _print(asked: ReportArguments, written: "WrittenReport") -> None:
    from ringlight.measure.json_record import to_json

    sys.stderr.write("".join(f"{note}\n" for note in written.notes))
    if asked.json:
        runs = [
            {"scene": run.scene, "label": label, "folder": str(run.folder), "report": run.report}
            for label, run in zip(written.labels, written.runs, strict=True)
        ]
        record = {"page": str(written.file), "bytes": written.bytes, "runs": runs, "notes": written.notes}
        sys.stdout.write(to_json(record))
        return
    sys.stderr.write(f"{written.bytes / MEGABYTE:.2f} MB, to be opened in a browser:\n")
    sys.stdout.write(f"{written.file}\n")
