"""Charts of a study, drawn with what draws the contact sheets: curves over a number, or a row of dots for each
variant."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from PIL import Image, ImageDraw, ImageFont

PAPER, INK, FAINT, GRID = "#ffffff", "#1c1f26", "#7a808c", "#e4e6eb"
COLORS = ("#0b5fa5", "#d1495b", "#2e8b57", "#b07d12", "#6f4ba0", "#2a9d9d", "#8c564b", "#1c1f26", "#e377c2", "#7f9c1c")
"""Of the lines, one after the other; told apart by colour-blind eyes too."""

WIDTH, HEIGHT, ROW = 560, 360, 30
"""Pixels of one chart of curves, and of one row of dots."""
MARGIN, GAP = 56, 30
TITLE, TEXT = 17, 13
DOT, CAP = 4, 5
"""Radius of a dot, half width of the bars' ends."""
MOST_TICKS, MOST_PLACES, FEWEST_MARKS = 6, 7, 3
WIDE = 50.0
"""Largest over smallest number beyond which an axis is logarithmic, unless a chart says otherwise."""


@dataclass(frozen=True)
class Dot:
    """A mean and its deviation over seeds; ``x`` is a number, or the index of a row."""

    x: float
    y: float
    deviation: float | None = None


@dataclass(frozen=True)
class Line:
    """Dots of one scene, or of one method."""

    label: str
    dots: tuple[Dot, ...]


@dataclass(frozen=True)
class Chart:
    """``names`` has a name for each row where ``x`` counts rows; empty for curves over a number.

    Where the largest number is more than ``wide`` times the smallest the axis is logarithmic.
    """

    title: str
    lines: tuple[Line, ...]
    names: tuple[str, ...] = ()
    wide: float = WIDE
    marked: bool = True
    """Whether each dot is shown, not the line alone."""
    measured: bool = False
    """Whether the numbers below were measured, so that round ones mark the axis, and not chosen by a study."""


def draw_charts(charts: Sequence[Chart], title: str) -> Image.Image:
    """The charts side by side under a title, the legend below. Numbers that are not finite have no dot."""
    charts = [_finite(chart) for chart in charts]
    pictures = [_dots(chart) if chart.names else _curves(chart) for chart in charts]
    labels = [line.label for line in charts[0].lines]
    width = max(sum(p.width for p in pictures), WIDTH)
    places = _legend(labels, width)
    below = 2 * GAP + TITLE + TEXT + places[-1][1] if places else 2 * GAP + TITLE + TEXT
    sheet = Image.new("RGB", (width, max(p.height for p in pictures) + below), PAPER)
    pen = ImageDraw.Draw(sheet)
    _text(pen, (GAP, GAP // 2), title, TITLE, INK)
    left = 0
    for picture in pictures:
        sheet.paste(picture, (left, GAP + TITLE))
        left += picture.width
    top = GAP + TITLE + max(p.height for p in pictures) + TEXT
    for index, (label, (left, down)) in enumerate(zip(labels, places, strict=True)):
        _dot(pen, (float(left + DOT), top + down + TEXT / 2 + 1), COLORS[index % len(COLORS)])
        _text(pen, (left + 4 * DOT, top + down), label, TEXT, INK)
    return sheet


def _finite(chart: Chart) -> Chart:
    lines = [
        replace(line, dots=tuple(d for d in line.dots if math.isfinite(d.x) and math.isfinite(d.y)))
        for line in chart.lines
    ]
    return replace(chart, lines=tuple(lines))


def _legend(labels: Sequence[str], width: int) -> list[tuple[int, int]]:
    """Where each label stands, from the left and below the first row; as many rows as ``width`` pixels ask for."""
    places, left, down = [], GAP, 0
    for label in labels:
        own = 4 * DOT + GAP + round(_font(TEXT).getlength(label))
        if left > GAP and left + own > width:
            left, down = GAP, down + 2 * TEXT
        places.append((left, down))
        left += own
    return places


def stacked(pictures: Sequence[Image.Image]) -> Image.Image:
    """One below the other."""
    sheet = Image.new("RGB", (max(p.width for p in pictures), sum(p.height for p in pictures)), PAPER)
    top = 0
    for picture in pictures:
        sheet.paste(picture, (0, top))
        top += picture.height
    return sheet


def decades(low: float, high: float) -> list[float]:
    """A few round numbers at about equal ratios, from ``low`` to ``high``, both above zero."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    marks: list[float] = []
    for factors in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7), (1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9)):
        every = (factor * 10.0**power for power in powers for factor in factors)
        marks = [mark for mark in every if low * (1 - 1e-9) <= mark <= high * (1 + 1e-9)]
        if len(marks) >= FEWEST_MARKS:
            break
    return marks


def ticks(low: float, high: float) -> list[float]:
    """A few round numbers from ``low`` to ``high``, at distances of 1, 2 or 5 times a power of ten."""
    span = high - low
    if not span > 0:
        return [low]
    raw = span / MOST_TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [index * step for index in range(first, math.floor(high / step + 1e-9) + 1)]


def _range(chart: Chart) -> tuple[float, float]:
    """Of the values with their deviations, a little wider."""
    dots = [dot for line in chart.lines for dot in line.dots]
    low = min((dot.y - (dot.deviation or 0) for dot in dots), default=0.0)
    high = max((dot.y + (dot.deviation or 0) for dot in dots), default=1.0)
    room = 0.08 * (high - low) or max(abs(high) * 0.01, 1e-3)
    return low - room, high + room


def _marks(places: Sequence[float], logarithmic: bool, measured: bool) -> Sequence[float]:
    """The numbers on the axis: those that a study chose, or round ones where they were measured."""
    if len(places) <= 1 or (len(places) <= MOST_PLACES and not measured):
        return places
    return (decades if logarithmic else ticks)(places[0], places[-1])


def _curves(chart: Chart) -> Image.Image:
    picture = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
    pen = ImageDraw.Draw(picture)
    low, high = _range(chart)
    places = sorted({dot.x for line in chart.lines for dot in line.dots})
    first = places[0] if places else 0.0
    last = places[-1] if len(places) > 1 else first + 1
    right, bottom = WIDTH - GAP, HEIGHT - MARGIN
    logarithmic = first > 0 and last > chart.wide * first

    def across(x: float) -> float:
        share = math.log(x / first) / math.log(last / first) if logarithmic else (x - first) / (last - first)
        return MARGIN + GAP / 2 + share * (right - MARGIN - GAP)

    def down(y: float) -> float:
        return bottom - (y - low) / (high - low) * (bottom - GAP)

    _text(pen, (MARGIN, 4), chart.title, TEXT, INK)
    for value in ticks(low, high):
        pen.line((MARGIN, down(value), right, down(value)), fill=GRID)
        _text(pen, (8, round(down(value)) - TEXT // 2), f"{value:g}", TEXT, FAINT)
    for place in _marks(places, logarithmic, chart.measured):
        label = f"{place:g}"
        _text(pen, (round(across(place) - _font(TEXT).getlength(label) / 2), bottom + 8), label, TEXT, FAINT)
    for index, line in enumerate(chart.lines):
        color = COLORS[index % len(COLORS)]
        dots = sorted(line.dots, key=lambda dot: dot.x)
        pen.line([(across(dot.x), down(dot.y)) for dot in dots], fill=color, width=2)
        for dot in dots if chart.marked else ():
            x, y = across(dot.x), down(dot.y)
            if dot.deviation is not None:
                above, below = down(dot.y + dot.deviation), down(dot.y - dot.deviation)
                for bar in ((x, above, x, below), (x - CAP, above, x + CAP, above), (x - CAP, below, x + CAP, below)):
                    pen.line(bar, fill=color)
            _dot(pen, (x, y), color)
    return picture


def _dots(chart: Chart) -> Image.Image:
    names = max(_font(TEXT).getlength(name) for name in chart.names)
    left = GAP + round(names) + DOT * 3
    height = GAP + ROW * len(chart.names) + MARGIN
    picture = Image.new("RGB", (left + WIDTH - MARGIN, height), PAPER)
    pen = ImageDraw.Draw(picture)
    low, high = _range(chart)
    right, bottom = picture.width - GAP, height - MARGIN

    def across(value: float) -> float:
        return left + (value - low) / (high - low) * (right - left)

    _text(pen, (left, 4), chart.title, TEXT, INK)
    for value in ticks(low, high):
        pen.line((across(value), GAP, across(value), bottom), fill=GRID)
        label = f"{value:g}"
        _text(pen, (round(across(value) - _font(TEXT).getlength(label) / 2), bottom + 6), label, TEXT, FAINT)
    for row, name in enumerate(chart.names):
        _text(pen, (GAP, GAP + ROW * row + ROW // 2 - TEXT // 2 - 2), name, TEXT, INK)
    for index, line in enumerate(chart.lines):
        color = COLORS[index % len(COLORS)]
        for dot in line.dots:
            y = GAP + ROW * dot.x + ROW / 2
            x = across(dot.y)
            if dot.deviation is not None:
                start, end = across(dot.y - dot.deviation), across(dot.y + dot.deviation)
                for bar in ((start, y, end, y), (start, y - CAP, start, y + CAP), (end, y - CAP, end, y + CAP)):
                    pen.line(bar, fill=color)
            _dot(pen, (x, y), color)
    return picture


def _dot(pen: ImageDraw.ImageDraw, center: tuple[float, float], color: str) -> None:
    x, y = center
    pen.ellipse((x - DOT, y - DOT, x + DOT, y + DOT), fill=color)


def _text(pen: ImageDraw.ImageDraw, corner: tuple[int, int], text: str, size: int, color: str) -> None:
    pen.text(corner, text, fill=color, font=_font(size))


def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)  # type: ignore[return-value]
