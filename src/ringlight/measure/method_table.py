"""Methods against scenes, one table a measure: on a terminal, as Markdown, LaTeX, CSV and plain values for JSON."""

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

from ringlight.measure.markdown import markdown_line, markdown_row, markdown_text
from ringlight.measure.method_cells import Measure, MethodCells
from ringlight.measure.study_table import Spread

MEAN = "mean"
MISSING = "-"
LATEX_SPECIAL = {c: "\\" + c for c in "&%$#_{}"} | {
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"
}  # fmt: skip

Styled = tuple[str, int]
"""A written number and its rank: 1 best, 2 second, 0 neither."""


@dataclass(frozen=True)
class MethodTable:
    """Prints itself with rich; best and second of each row are marked."""

    cells: MethodCells

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        """Rich's protocol. Where methods do not fit beside each other, they follow in further tables."""
        for measure in self.cells.shown():
            yield Text(heading(measure), style="bold")
            rows = self.rows(measure)
            for part in _parts(["scene", *self.cells.methods], rows, options.max_width):
                table = Table(box=SIMPLE_HEAD, pad_edge=False)
                table.add_column("scene", no_wrap=True)
                for at in part:
                    table.add_column(self.cells.methods[at], justify="right", no_wrap=True)
                for name, row in rows:
                    table.add_row(name, *(Text(row[at][0], style=STYLES[row[at][1]]) for at in part))
                yield table
        for note in self.notes():
            yield Text(note, style="dim")

    def rows(self, measure: Measure) -> list[tuple[str, list[Styled]]]:
        """Each scene's numbers, in the order of the methods; last the mean, if there is more than one scene."""
        named: list[tuple[str, Callable[[str], Spread | None]]] = [
            (scene, lambda method, scene=scene: self.cells.cell(measure, scene, method))  # type: ignore[misc]
            for scene in self.cells.scenes
        ]
        if len(self.cells.scenes) > 1 and self.cells.common_scenes(measure):
            named.append((MEAN, lambda method: self.cells.mean(measure, method)))
        rows = []
        for name, value in named:
            spreads = {method: value(method) for method in self.cells.methods}
            ranks = self.cells.ranks(measure, spreads)
            rows.append((name, [(written(spread, measure), ranks.get(m, 0)) for m, spread in spreads.items()]))
        return rows

    def notes(self) -> tuple[str, ...]:
        """What a reader must know beside the numbers, one sentence each."""
        notes = []
        if len(self.cells.seeds) > 1:
            notes.append(f"± is the standard deviation over {len(self.cells.seeds)} seeds.")
        shown = self.cells.shown()
        if len(self.cells.scenes) > 1 and shown:
            common = self.cells.common_scenes(shown[0])
            if not common:
                notes.append("There is no mean: no scene has all runs of all methods.")
            elif len(common) < len(self.cells.scenes):
                notes.append(
                    f"The mean is over {', '.join(common)}, which all methods with runs have, of the same seeds."
                )
        if len(self.cells.machines) > 1 and any(measure.of_machine for measure in shown):
            notes.append("Wall seconds and frames a second are of several machines or numbers of threads: not ranked.")
        return (*notes, *self.cells.notes)

    def markdown(self) -> str:
        """A GitHub table a measure: best bold, second italic."""
        lines = []
        for measure in self.cells.shown():
            lines += [f"**{heading(measure)}**", ""]
            lines.append(markdown_row(["scene", *map(markdown_text, self.cells.methods)]))
            lines.append(markdown_row([":--", *["--:"] * len(self.cells.methods)]))
            for name, row in self.rows(measure):
                marked = [("{}", "**{}**", "*{}*")[rank].format(text) for text, rank in row]
                lines.append(markdown_row([markdown_text(name), *marked]))
            lines.append("")
        notes = ("Best bold, second italic.", *self.notes())
        return "\n".join([*lines, *(f"- {markdown_line(note)}" for note in notes)]) + "\n"

    def latex(self) -> str:
        """A ``table`` a measure, for the booktabs package: best bold, second underlined."""
        lines = ["% \\usepackage{booktabs}"]
        for measure in self.cells.shown():
            lines += ["\\begin{table}", "\\centering", f"\\caption{{{_latex(heading(measure))}.}}"]
            lines += [f"\\begin{{tabular}}{{l{'r' * len(self.cells.methods)}}}", "\\toprule"]
            lines += [" & ".join(["scene", *map(_latex, self.cells.methods)]) + r" \\", "\\midrule"]
            for name, row in self.rows(measure):
                if name == MEAN:
                    lines.append("\\midrule")
                marked = [
                    ("{}", "\\textbf{{{}}}", "\\underline{{{}}}")[rank].format(text.replace("±", "$\\pm$"))
                    for text, rank in row
                ]
                lines.append(" & ".join([_latex(name), *marked]) + r" \\")
            lines += ["\\bottomrule", "\\end{tabular}", "\\end{table}", ""]
        return "\n".join([*lines, *(f"% {' '.join(note.split())}" for note in self.notes())]) + "\n"

    def csv(self) -> str:
        """A line for each run that is in the table: scene, method, seed, and each measure in full."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        shown = self.cells.shown()
        writer.writerow(["scene", "method", "seed", *(measure.key for measure in shown)])
        for (scene, method), by_seed in self.cells.reports.items():
            for seed, report in by_seed.items():
                values = [measure.of(report) for measure in shown]
                writer.writerow([scene, method, seed, *("" if value is None else value for value in values)])
        return text.getvalue()

    def plain(self) -> dict[str, Any]:
        """Means, deviations and ranks by measure, for JSON."""
        return {measure.key: self._plain(measure) for measure in self.cells.shown()}

    def _plain(self, measure: Measure) -> dict[str, Any]:
        def row(spreads: Mapping[str, Spread | None]) -> dict[str, Any]:
            ranks = self.cells.ranks(measure, spreads)
            return {
                name: None if s is None else {"mean": s.mean, "deviation": s.deviation, "rank": ranks.get(name)}
                for name, s in spreads.items()
            }

        methods = self.cells.methods
        return {
            "unit": measure.unit,
            "more_is_better": measure.more_is_better,
            "scenes": {s: row({m: self.cells.cell(measure, s, m) for m in methods}) for s in self.cells.scenes},
            "mean_over": list(self.cells.common_scenes(measure)),
            "mean": row({m: self.cells.mean(measure, m) for m in methods}),
        }


STYLES = ("", "bold green", "underline")
"""By rank."""

GAP = 3
"""Characters between columns."""


def heading(measure: Measure) -> str:
    """What stands above a table."""
    unit = f", {measure.unit}" if measure.unit else ""
    return f"{measure.title}{unit} ({'more' if measure.more_is_better else 'less'} is better)"


def written(spread: Spread | None, measure: Measure) -> str:
    """A cell's text."""
    if spread is None:
        return MISSING
    mean = f"{spread.mean:,.{measure.digits}f}"
    return mean if spread.deviation is None else f"{mean} ± {spread.deviation:,.{measure.digits}f}"


def _parts(heads: list[str], rows: list[tuple[str, list[Styled]]], width: int) -> list[list[int]]:
    """Methods, by place, table by table: as many beside each other as ``width`` characters hold, and at least one."""
    first = max(len(heads[0]), *(len(name) for name, _ in rows))
    widths = [max(len(head), *(len(row[at][0]) for _, row in rows)) + GAP for at, head in enumerate(heads[1:])]
    parts: list[list[int]] = [[]]
    for at, own in enumerate(widths):
        if parts[-1] and first + own + sum(widths[other] for other in parts[-1]) > width:
            parts.append([])
        parts[-1].append(at)
    return parts


def _latex(text: str) -> str:
    return "".join(LATEX_SPECIAL.get(character, character) for character in text)
