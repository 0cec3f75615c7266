"""The columns of the results table: what each shows, how it is written, what counts as better, what goes first."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from ringlight.core.words import MEGABYTE, numbered
from ringlight.measure.report import Report

Better = Literal["more", "less", ""]

Value = float | int | None
"""What a run measured; None if it did not."""
Measure = Callable[[Report], Value]

MISSING = "-"
UNAVAILABLE = "unavailable"

LPIPS_NETS = ("vgg", "alex")
"""In order of preference; a table shows one."""


@dataclass(frozen=True)
class Row:
    """One run, and the run of the same scene that it is compared with."""

    label: str
    report: Report
    baseline: Report | None = None


@dataclass(frozen=True)
class Heading:
    """``rank``: 0 is never left out, the largest goes first on a narrow terminal."""

    title: str
    rank: int
    is_name: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class Column(Heading):
    """Of a report. ``always``: shown though empty."""

    write: Callable[[Row], str]
    measure: Measure | None = None
    better: Better = ""
    always: bool = True


@dataclass(frozen=True)
class Cell:
    """What is written, and whether it is the best of its scene."""

    text: str
    best: bool = False


def lpips(report: Report, net: str | None) -> float | None:
    """LPIPS of this net; None if it was not measured, or there is no net."""
    value: float | None = getattr(report, f"lpips_{net}") if net else None
    return value


def columns(lpips_net: str | None, nouns: Collection[str], tested: bool = True) -> tuple[Column, ...]:
    """All columns from left to right; LPIPS is the one of ``lpips_net``, None if no run has any. Where no run was
    ``tested`` on views of its scene, training PSNR is never left out.

    ``nouns`` are what the models are made of: where they differ the numbers have their nouns, and do not compete.
    """

    def distance(report: Report) -> float | None:
        return lpips(report, lpips_net)

    return (
        Column("run", 0, lambda row: row.label, is_name=True),
        Column("scene", 2, lambda row: row.report.scene, is_name=True),
        _measured("PSNR", 0, lambda report: report.psnr, "more", _fixed(2)),
        _difference("dPSNR", 5, lambda report: report.psnr, 2),
        _optional("PSNR train", 12 if tested else 0, lambda report: report.psnr_train, "", _fixed(2)),
        _optional("PSNR far", 15, lambda report: report.psnr_far, "more", _fixed(2)),
        _measured("SSIM", 4, lambda report: report.ssim_same, "more", _fixed(4)),
        _difference("dSSIM", 13, lambda report: report.ssim_same, 4),
        Column(f"LPIPS {lpips_net or ''}".strip(), 6, partial(_written_lpips, lpips_net), distance, "less"),
        _difference("dLPIPS", 14, distance, 4),
        _counted(nouns),
        _measured("raw MB", 1, lambda report: report.bytes_raw, "less", _megabytes),
        Column("x raw", 3, _size_ratio, always=False),
        _measured("file MB", 7, lambda report: report.bytes_file, "less", _megabytes),
        _measured("train", 8, lambda report: report.train_seconds, "less", _duration),
        _optional("core s", 10, lambda report: report.core_seconds, "", _whole),
        _optional("peak MB", 16, lambda report: report.peak_bytes, "less", _megabytes),
        _measured("it/s", 11, lambda report: report.steps_per_second, "more", _rate),
        _measured("FPS", 9, lambda report: report.fps, "more", _rate),
    )


def cells(shown: Sequence[Column], rows: Sequence[Row]) -> list[list[Cell]]:
    """The rows of one scene, written; the best are marked where there is more than one to choose from."""
    written = [_column_cells(column, rows) for column in shown]
    return [list(row) for row in zip(*written, strict=True)]


def _column_cells(column: Column, rows: Sequence[Row]) -> list[Cell]:
    values = [column.measure(row.report) if column.measure else None for row in rows]
    return marked([column.write(row) for row in rows], values, column.better)


def marked(texts: Sequence[str], values: Sequence[Value], better: Better) -> list[Cell]:
    """The cells of one column, the best of them marked where there is more than one to choose from."""
    known = [value for value in values if value is not None and not math.isnan(value)]
    if len(known) < 2 or not better:
        return [Cell(text) for text in texts]
    best = max(known) if better == "more" else min(known)
    # What reads the same is equally good: the digits beyond are noise. Where all read the same, nothing is best.
    winner = texts[values.index(best)]
    return [Cell(text, best=text == winner and len(set(texts)) > 1) for text in texts]


def _measured(title: str, rank: int, measure: Measure, better: Better, write: Callable[[Value], str]) -> Column:
    return Column(title, rank, lambda row: write(measure(row.report)), measure, better)


def _optional(title: str, rank: int, measure: Measure, better: Better, write: Callable[[Value], str]) -> Column:
    """Left out where no run has it."""
    return replace(_measured(title, rank, measure, better, write), always=False)


def _counted(nouns: Collection[str]) -> Column:
    if len(nouns) == 1:
        return _measured(next(iter(nouns)), 10, lambda report: report.counted, "less", "{:,.0f}".format)
    return Column("made of", 10, lambda row: numbered(row.report.counted, row.report.noun))


def _written_lpips(net: str | None, row: Row) -> str:
    """Of a run without test views, or where nobody asked for it, it is missing like all else; of another its weights
    were, which its report says."""
    value = lpips(row.report, net)
    return UNAVAILABLE if value is None and row.report.lpips_note else _fixed(4)(value)


def _difference(title: str, rank: int, measure: Measure, digits: int) -> Column:
    """Signed difference from the baseline; nothing for the baseline itself."""

    def write(row: Row) -> str:
        mine = measure(row.report)
        theirs = measure(row.baseline) if row.baseline else None
        if row.baseline is row.report or mine is None or theirs is None or math.isnan(mine - theirs):
            return MISSING
        return f"{mine - theirs:+.{digits}f}"

    return Column(title, rank, write, always=False)


def _size_ratio(row: Row) -> str:
    if row.baseline is None or row.baseline is row.report or row.baseline.bytes_raw == 0:
        return MISSING
    return f"{row.report.bytes_raw / row.baseline.bytes_raw:.2f}"


def _fixed(digits: int) -> Callable[[Value], str]:
    return lambda value: MISSING if value is None else f"{value:.{digits}f}"


def _megabytes(count: Value) -> str:
    return MISSING if count is None else f"{count / MEGABYTE:.2f}"


def _duration(seconds: Value) -> str:
    """ "47s", "4m07s", "2h05m"."""
    if seconds is None or not math.isfinite(seconds):
        return MISSING
    whole = round(seconds)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}m"


def _whole(value: Value) -> str:
    return MISSING if value is None else f"{value:.0f}"


def _rate(value: Value) -> str:
    """Three significant digits while small, whole numbers when large."""
    if value is None:
        return MISSING
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}"
