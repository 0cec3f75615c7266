"""The table of a study: mean and spread over seeds of what each variant measures, scene by scene and over all
scenes."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import get_args, get_type_hints

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

from ringlight.core.raw_bytes import FLOAT_BYTES
from ringlight.core.words import MEGABYTE
from ringlight.measure.markdown import markdown_line, markdown_row, markdown_text
from ringlight.measure.report import Report

ALL_SCENES = "all scenes"

FIELD_PARTS = ("color.", "shader.")
"""Parts of a model that Gaussians share."""

NOT_LEARNED = ("color.box", "color.lit", "color.active_degree")
"""Buffers among them."""


@dataclass(frozen=True)
class Spread:
    """Mean over seeds, and their standard deviation; None for a single seed."""

    mean: float
    deviation: float | None

    @staticmethod
    def of(values: Sequence[float]) -> "Spread":
        """Of at least one value; without a deviation where one is infinite, as the PSNR of a picture without error."""
        known = len(values) > 1 and all(map(math.isfinite, values))
        return Spread(fmean(values), stdev(values) if known else None)


@dataclass(frozen=True)
class StudyRow:
    """One variant on one scene, or on all. ``at`` is the number that the study varies, ``paper`` dB on
    Shiny-Blender."""

    scene: str
    variant: str
    about: str
    at: float | None
    paper: float | None
    seeds: int
    psnr: Spread
    ssim: Spread
    lpips_alex: Spread | None
    psnr_train: Spread | None
    psnr_far: Spread | None
    """Over the third of the test views that lies farthest from the training cameras."""
    raw_megabytes: Spread
    gaussians: Spread
    train_seconds: Spread
    """Wall clock; on a machine that does other things besides, CPU seconds say more."""
    core_seconds: Spread | None
    """Processor seconds of the training, and of the trial before it."""
    shared_parameters: Spread
    """Numbers that all Gaussians share: field, networks, maps."""


@dataclass(frozen=True)
class Label:
    """What a row says of its variant."""

    name: str
    about: str
    at: float | None = None
    paper: float | None = None


Results = Mapping[str, Mapping[str, Mapping[int, Report]]]
"""Reports by scene, variant and seed."""


def study_rows(labels: Sequence[Label], results: Results) -> tuple[StudyRow, ...]:
    """A row for each scene and variant that has a report; of several scenes also their mean, for variants that have the
    same seeds on all. A scene of ``results`` may have no report: then no mean is over all."""
    rows = [
        _row(label, scene, [[report] for report in by_variant[label.name].values()])
        for scene, by_variant in results.items()
        for label in labels
        if by_variant.get(label.name)
    ]
    if len(results) > 1:
        for label in labels:
            runs = [by_variant.get(label.name, {}) for by_variant in results.values()]
            seeds = runs[0].keys()
            if seeds and all(run.keys() == seeds for run in runs):
                rows.append(_row(label, ALL_SCENES, [[run[seed] for run in runs] for seed in seeds]))
    return tuple(rows)


def _row(label: Label, scene: str, seeds: list[list[Report]]) -> StudyRow:
    """``seeds`` holds for each seed the reports whose mean counts: one, or one for each scene."""

    def spread(measure: str) -> Spread:
        return Spread.of([fmean(float(getattr(report, measure) or 0) for report in reports) for reports in seeds])

    def known(measure: str) -> Spread | None:
        missing = any(getattr(report, measure) is None for reports in seeds for report in reports)
        return None if missing else spread(measure)

    size = [fmean(report.bytes_raw / MEGABYTE for report in reports) for reports in seeds]
    shared = [fmean(shared_parameters(report) for report in reports) for reports in seeds]
    return StudyRow(
        scene, label.name, label.about, label.at, label.paper, len(seeds),
        spread("psnr"), spread("ssim_same"), known("lpips_alex"), known("psnr_train"), known("psnr_far"),
        Spread.of(size), spread("counted"), spread("train_seconds"), known("core_seconds"), Spread.of(shared),
    )  # fmt: skip


def shared_parameters(report: Report) -> int:
    """Learned numbers that the Gaussians of a model share."""
    parts = report.bytes_by_part.items()
    learned = (count for part, count in parts if part.startswith(FIELD_PARTS) and part not in NOT_LEARNED)
    return sum(learned) // FLOAT_BYTES


HEADINGS = (
    "variant", "", "PSNR", "train", "far", "SSIM", "LPIPS",
    "raw MB", "Gaussians", "train s", "core s", "shared", "paper*",
)  # fmt: skip
LEAST_FIRST = ("", "LPIPS", "shared", "paper*", "far", "train", "train s", "core s", "Gaussians", "SSIM")
"""Columns that a narrow terminal goes without, in this order: numbers are never cut."""
GAP = 3
"""Characters between columns: a blank on either side, and the box."""
NOTES = {
    "train": "train: PSNR on training views.",
    "far": "far: PSNR on the third of the test views farthest from training views.",
    "PSNR": "± is over seeds.",
    "paper*": "* PSNR that the paper reports, mean over Shiny-Blender: other scenes, another machine.",
}
"""What stands below a table, by the column that it is about."""


@dataclass(frozen=True)
class StudyTable:
    """The rows, printed by rich or as markdown or CSV; ``notes`` are sentences on what is missing."""

    rows: tuple[StudyRow, ...]
    notes: tuple[str, ...] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        """Rich's protocol: a table for each scene."""
        headings: set[str] = set()
        for scene in dict.fromkeys(row.scene for row in self.rows):
            yield Text(scene if scene == ALL_SCENES else f"scene {scene}", style="bold")
            rows = [_cells(row) for row in self.rows if row.scene == scene]
            table = Table(box=SIMPLE_HEAD, pad_edge=False)
            shown = _fitting(rows, options.max_width)
            headings |= {HEADINGS[index] for index in shown}
            for index in shown:
                table.add_column(HEADINGS[index], justify="left" if index < 2 else "right", no_wrap=True)
            for cells in rows:
                table.add_row(*(cells[index] for index in shown))
            yield table
        yield Text(" ".join(note for heading, note in NOTES.items() if heading in headings), style="dim")
        for note in self.notes:
            yield Text(note, style="dim")

    def markdown(self) -> str:
        """A GitHub table for each scene."""
        lines = []
        for scene in dict.fromkeys(row.scene for row in self.rows):
            rulers = [":--", ":--", *["--:"] * (len(HEADINGS) - 2)]
            lines += [f"**{markdown_text(scene.strip())}**", "", _markdown_row(HEADINGS), markdown_row(rulers)]
            lines += [*(_markdown_row(_cells(row)) for row in self.rows if row.scene == scene), ""]
        return "\n".join([*lines, *(markdown_line(note) + "\n" for note in (" ".join(NOTES.values()), *self.notes))])

    def csv(self) -> str:
        """One line a row, mean and deviation in columns of their own; empty where there is none."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        spreads = [name for name, kind in get_type_hints(StudyRow).items() if Spread in (kind, *get_args(kind))]
        plain = [name for name in vars(self.rows[0]) if name not in spreads]
        writer.writerow([*plain, *(column for name in spreads for column in (name, f"{name}_deviation"))])
        for row in self.rows:
            values = [getattr(row, name) for name in plain]
            pairs = [getattr(row, name) or Spread(math.nan, None) for name in spreads]
            values += [value for pair in pairs for value in (pair.mean, pair.deviation)]
            writer.writerow(["" if value is None or value != value else value for value in values])
        return text.getvalue()


def _markdown_row(texts: Sequence[str]) -> str:
    return markdown_row([markdown_text(text) for text in texts])


def _fitting(rows: Sequence[Sequence[str]], width: int) -> list[int]:
    """The columns that fit into ``width`` characters, by their place among the headings."""
    widths = [max(len(cells[index]) for cells in (HEADINGS, *rows)) for index in range(len(HEADINGS))]
    shown = list(range(len(HEADINGS)))
    for heading in LEAST_FIRST:
        if sum(widths[index] for index in shown) + GAP * len(shown) > width:
            shown.remove(HEADINGS.index(heading))
    return shown


def _cells(row: StudyRow) -> list[str]:
    return [
        row.variant,
        row.about,
        _written(row.psnr, 2),
        "-" if row.psnr_train is None else f"{row.psnr_train.mean:.2f}",
        "-" if row.psnr_far is None else f"{row.psnr_far.mean:.2f}",
        _written(row.ssim, 4),
        "-" if row.lpips_alex is None else _written(row.lpips_alex, 4),
        f"{row.raw_megabytes.mean:.2f}",
        f"{row.gaussians.mean:,.0f}",
        f"{row.train_seconds.mean:.0f}",
        "-" if row.core_seconds is None else f"{row.core_seconds.mean:.0f}",
        f"{row.shared_parameters.mean:,.0f}",
        "-" if row.paper is None else f"{row.paper:.2f}",
    ]


def _written(spread: Spread, digits: int) -> str:
    if spread.deviation is None:
        return f"{spread.mean:.{digits}f}"
    return f"{spread.mean:.{digits}f} ± {spread.deviation:.{digits}f}"
