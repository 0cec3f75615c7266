"""Models by the error of their normals, one row each; prints itself with rich."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

from ringlight.measure.columns import MISSING, Better, Cell, Heading, Value, marked
from ringlight.measure.normal_error import NEAR, NormalScore
from ringlight.measure.table import Grid

FEW = 0.5
"""Share of the true surface below which it is said that a model covers little of it."""


@dataclass(frozen=True)
class NormalsTable:
    """``rows``: a label and its score; ``views`` is how many were compared."""

    rows: Sequence[tuple[str, NormalScore]]
    views: int

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        """Rich's protocol: leaves out the least important columns that do not fit."""
        yield self.grid().fitting(options.max_width).table(options.max_width)
        for note in self.notes():
            yield Text(note, style="dim")

    def grid(self) -> Grid:
        """Everything, written; the best of each column marked."""
        scores = [score for _, score in self.rows]
        written = [[Cell(label) for label, _ in self.rows]]
        for measure in MEASURES:
            values = [measure.of(score) for score in scores]
            written.append(marked([_text(value, measure.form) for value in values], values, measure.better))
        written.append([Cell(str(self.views))] * len(self.rows))
        headings = [Heading("run", 0, is_name=True), *(measure.heading for measure in MEASURES), Heading("views", 4)]
        return Grid(headings, [list(zip(*written, strict=True))])

    def notes(self) -> tuple[str, ...]:
        """What a reader must know beside the numbers, one sentence each."""
        few = [label for label, score in self.rows if score.compared < FEW]
        return tuple(
            f"{label} covers less than {FEW:.0%} of the true surface; is this the truth of its scene?" for label in few
        )


@dataclass(frozen=True)
class _Measure:
    heading: Heading
    of: Callable[[NormalScore], Value]
    better: Better
    form: str


MEASURES = (
    _Measure(Heading("mean deg", 0), lambda score: score.mean, "less", "{:.1f}"),
    _Measure(Heading("median deg", 1), lambda score: score.median, "less", "{:.1f}"),
    _Measure(Heading(f"< {NEAR} deg", 3), lambda score: score.within_11_25, "more", "{:.1%}"),
    _Measure(Heading("compared", 2), lambda score: score.compared, "", "{:.1%}"),
)
"""From left to right. What is compared competes in no column: it is of the shape."""


def _text(value: Value, form: str) -> str:
    return MISSING if value is None else form.format(value)
