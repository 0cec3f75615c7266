"""Reports as one table: on a terminal of any width, and as markdown. Numbers are never wrapped or cut."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

from ringlight.measure.columns import LPIPS_NETS, MISSING, Cell, Heading, Row, cells, columns, lpips
from ringlight.measure.differing_settings import differing_settings
from ringlight.measure.markdown import markdown_line, markdown_row, markdown_text
from ringlight.measure.report import Report

MIN_NAME_WIDTH = 16
"""Names are cut to this many characters before a column of numbers is left out."""

MANY_OFF = 0.5
"""Share of hidden units that are off from which on it is said: healthy networks have a quarter at most."""

GAP = 2
"""Blanks between columns."""

CUT = ".."
"""Ends a name that was cut; ASCII, because a terminal may know nothing else."""


@dataclass(frozen=True)
class ResultsTable:
    """Runs, each with its label, grouped by scene; prints itself with rich, as wide as the terminal allows.

    ``baseline`` is the label that the other runs of the same scene are compared with. The best value of each scene
    is marked, where runs differ. ``lpips_notes`` stand in place of what the reports say of a missing LPIPS, which may
    be true no longer.
    """

    runs: Sequence[tuple[str, Report]]
    baseline: str | None = None
    lpips_notes: Sequence[str] | None = None

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        """Rich's protocol: leaves out the least important columns that do not fit."""
        grid = self.grid()
        scenes = {report.scene for _, report in self.runs}
        if len(scenes) == 1:
            grid = grid.without("scene")
            yield Text(f"scene {scenes.pop()}", style="bold")
        fitting = grid.fitting(options.max_width)
        yield fitting.table(options.max_width)
        for note in self.notes():
            yield Text(note, style="dim")
        left_out = [c.title for c in grid.columns if c.title not in {kept.title for kept in fitting.columns}]
        if left_out and len(self.runs) > 1:  # who compares misses them
            wider = "a wider terminal or 'ringlight compare --markdown' shows all"
            yield Text(f"Too narrow here for {', '.join(left_out)}; {wider}.", style="dim")

    def markdown(self) -> str:
        """All columns as a GitHub table, the best values of each scene in bold; ends with the notes."""
        grid = self.grid()
        lines = [
            markdown_row([markdown_text(column.title) for column in grid.columns]),
            markdown_row([":--" if column.is_name else "--:" for column in grid.columns]),
            *(markdown_row([_marked(cell) for cell in row]) for row in grid.rows()),
        ]
        return "\n".join([*lines, *(f"\n{markdown_line(note)}" for note in self.notes())]) + "\n"

    def notes(self) -> tuple[str, ...]:
        """What a reader must know beside the numbers, one sentence each."""
        baselines = self._baselines()
        compared = any(baselines.get(report.scene, report) is not report for _, report in self.runs)
        notes = [f"Differences and ratios are from {self.baseline}."] if compared else []
        for label, report in self.runs:
            if report.planned is not None and report.iterations is not None and report.iterations < report.planned:
                notes.append(f"{label} stopped at step {report.iterations} of {report.planned}.")
            if report.psnr is None:
                notes.append(f"{label} has no test views.")
        notes += [
            f"{label} was trained on {report.test_views_trained_on} of the {len(report.images)} test views."
            for label, report in self.runs
            if report.test_views_trained_on
        ]
        notes += differing_settings(self.runs)
        notes += [f"{label}: {sentence}." for label, report in self.runs for sentence in report.collapses]
        notes += [f"{label}: {note}" for label, report in self.runs if (note := light_note(report))]
        if self.lpips_notes is not None:
            return (*notes, *self.lpips_notes)
        return (*notes, *sorted({report.lpips_note for _, report in self.runs if report.lpips_note}))

    def _baselines(self) -> dict[str, Report]:
        """By scene, the run that others are compared with."""
        return {report.scene: report for label, report in reversed(self.runs) if label == self.baseline}

    def grid(self) -> "Grid":
        """Everything that is known, written: columns that no run has are left out."""
        baselines = self._baselines()
        reports = [report for _, report in self.runs]
        tested = any(report.psnr is not None for report in reports)
        shown = columns(_common_lpips(reports), {report.noun for report in reports}, tested)
        scenes: dict[str, list[Row]] = {}
        for label, report in self.runs:
            scenes.setdefault(report.scene, []).append(Row(label, report, baselines.get(report.scene)))
        grid = Grid(shown, [cells(shown, rows) for rows in scenes.values()])
        silent = [
            c.title for i, c in enumerate(shown) if not c.always and all(r[i].text == MISSING for r in grid.rows())
        ]
        for title in silent:
            grid = grid.without(title)
        return grid


@dataclass(frozen=True)
class Grid:
    """Written cells: columns, and for each scene its rows."""

    columns: Sequence[Heading]
    scenes: Sequence[Sequence[Sequence[Cell]]]

    def rows(self) -> list[Sequence[Cell]]:
        """Of all scenes, one after the other."""
        return [row for rows in self.scenes for row in rows]

    def without(self, title: str) -> "Grid":
        """The same without the column of this title."""
        kept = [index for index, column in enumerate(self.columns) if column.title != title]
        scenes = [[[row[index] for index in kept] for row in rows] for rows in self.scenes]
        return Grid([self.columns[index] for index in kept], scenes)

    def fitting(self, width: int) -> "Grid":
        """The same without the least important columns that do not fit into ``width`` characters, once names are
        cut."""
        _, excess = self._widths(width)
        last = max(self.columns, key=lambda column: column.rank)
        return self.without(last.title).fitting(width) if excess > 0 and last.rank > 0 else self

    def _widths(self, width: int) -> tuple[list[int], int]:
        """Of the columns, names cut as far as ``width`` asks and they may be, and by how much that is still too
        wide."""
        texts = [[column.title, *(row[i].text for row in self.rows())] for i, column in enumerate(self.columns)]
        widths = [max(map(len, column)) for column in texts]
        excess = sum(widths) + GAP * (len(widths) - 1) - width
        for index in sorted(range(len(widths)), key=lambda i: -widths[i]):
            if self.columns[index].is_name:
                spared = max(0, min(excess, widths[index] - MIN_NAME_WIDTH))
                widths[index], excess = widths[index] - spared, excess - spared
        return widths, excess

    def table(self, width: int) -> Table:
        """For a terminal of ``width`` characters, into which its columns fit."""
        widths, _ = self._widths(width)
        # The box puts one blank between columns; the padding makes up the rest.
        table = Table(box=SIMPLE_HEAD, padding=(0, GAP - 1, 0, 0), pad_edge=False, show_edge=False)
        for column, width in zip(self.columns, widths, strict=True):
            table.add_column(column.title, justify="left" if column.is_name else "right", no_wrap=True, width=width)
        for rows in self.scenes:
            for row in rows:
                table.add_row(*(_styled(cell, width) for cell, width in zip(row, widths, strict=True)))
            table.add_section()
        return table


def _styled(cell: Cell, width: int) -> Text:
    text = cell.text if len(cell.text) <= width else cell.text[: width - len(CUT)] + CUT
    return Text(text, style="bold green" if cell.best else "dim" if cell.text == MISSING else "")


def _marked(cell: Cell) -> str:
    text = markdown_text(cell.text)
    return f"**{text}**" if cell.best else text


def light_note(report: Report) -> str | None:
    """What to know of the light's features; None where there are none, or none is idle."""
    saturated, constant = report.saturated_features or 0, report.constant_features or 0
    off = report.hidden_units_off or 0
    if saturated or constant:
        return f"{saturated:.0%} of the light's features are saturated and {constant:.0%} constant."
    return f"{off:.0%} of the light's hidden units are off." if off >= MANY_OFF else None


def _common_lpips(reports: Sequence[Report]) -> str | None:
    """The net that most runs have measured, so that the column compares; in doubt the first of ``LPIPS_NETS``."""
    counts = {net: sum(lpips(report, net) is not None for report in reports) for net in LPIPS_NETS}
    return max(LPIPS_NETS, key=lambda net: counts[net]) if any(counts.values()) else None
