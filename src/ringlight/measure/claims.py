"""The paper's claims as comparisons: what each of its numbers says of the method beside another one's.

The numbers are in ``claims.json``, table by table as the paper prints them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ringlight.measure.json_record import from_json

RECORD = Path(__file__).with_name("claims.json")


@dataclass(frozen=True)
class DataSet:
    """Our ``scenes`` that stand for one of the paper's data sets, and how much of it they are."""

    scenes: tuple[str, ...]
    about: str


@dataclass(frozen=True)
class PaperRow:
    """A line of a table: ``values`` by data set and measure; ``subject`` is our method, or a study's variant."""

    name: str
    subject: str
    values: dict[str, dict[str, float]]


@dataclass(frozen=True)
class PaperTable:
    """``of`` names the row that all others are held against; ``study`` ours that repeats it, None for a table of
    methods."""

    where: str
    study: str | None
    of: str
    rows: tuple[PaperRow, ...]
    command: str

    @property
    def own(self) -> PaperRow:
        """The row of the method itself."""
        return next(row for row in self.rows if row.name == self.of)


@dataclass(frozen=True)
class Figure:
    """A picture of the paper, ``why`` it cannot be tested by a number, and what makes ours."""

    where: str
    says: str
    why: str
    command: str


@dataclass(frozen=True)
class Paper:
    """All that is held against our records."""

    paper: str
    steps: int
    data_sets: dict[str, DataSet]
    tables: tuple[PaperTable, ...]
    figures: tuple[Figure, ...]


@dataclass(frozen=True)
class Claim:
    """One comparison of the paper: of ``own`` with ``other`` on a data set, by measure; values are (own, other)."""

    table: PaperTable
    data_set: str
    own: PaperRow
    other: PaperRow
    values: dict[str, tuple[float, float]]


def paper_claims() -> Paper:
    """The record in the package."""
    return from_json(Paper, RECORD.read_text(encoding="utf-8"), str(RECORD))


def claims_of(table: PaperTable) -> Iterator[Claim]:
    """Every other row beside the method's own, data set by data set, with the measures that both have."""
    own = table.own
    for data_set, ours in own.values.items():
        for other in table.rows:
            theirs = other.values.get(data_set, {})
            values = {name: (value, theirs[name]) for name, value in ours.items() if name in theirs}
            if other is not own and values:
                yield Claim(table, data_set, own, other, values)
