"""Charts as SVG: lines over a number, whose values the page's script shows under the pointer."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ringlight.core.visible_text import visible
from ringlight.measure.curves import ticks
from ringlight.measure.report import CurvePoint
from ringlight.pages.markup import Html, element, joined

WIDTH, HEIGHT = 420, 250
"""Units of a chart; a page scales it."""

LEFT, RIGHT, TOP, BOTTOM = 52, 12, 28, 30
"""Units round the lines, for the numbers on the axes and the title."""

ROOM = 0.06
"""Share of the values' range that stays free above and below the lines."""

NUMBER_DROP = 4
"""Units from the middle of a digit to the foot of its line."""

COLORS = 6
"""Of lines; those beyond begin again, dashed."""


def dot(index: int) -> Html:
    """The mark of a run's colour beside its name."""
    return element("i", class_=f"dot c{index % COLORS}")


@dataclass(frozen=True)
class Curve:
    """One run's line; ``index`` chooses its colour, the same in all charts."""

    label: str
    index: int
    xs: tuple[float, ...]
    ys: tuple[float, ...]


@dataclass(frozen=True)
class Chart:
    """``names`` are what stands at each x, where x counts things; ``dotted``: the values have nothing between them."""

    title: str
    x_name: str
    curves: tuple[Curve, ...]
    names: tuple[str, ...] = ()
    dotted: bool = False


LEAST_RANGE = 1e-12
"""Of an axis: a smaller one, as of a damaged report, has no ticks that a double can count."""

LARGEST = 1e12
"""Of values in a chart: steps, seconds, decibels, thousands."""

Measure = Callable[[CurvePoint], float | None]

QUANTITIES: tuple[tuple[str, Measure], ...] = (
    ("PSNR of training photographs, dB", lambda point: point.psnr),
    ("loss with all its terms", lambda point: point.loss),
    ("thousand {nouns}", lambda point: point.counted / 1e3),
)
"""What is drawn of a training, over its steps and over its seconds."""


def training_charts(
    runs: Sequence[tuple[str, int, Sequence[CurvePoint]]], nouns: str, over_seconds: bool
) -> list[Chart]:
    """One chart for each quantity that a run knows; ``runs`` are label, colour and curve."""
    charts = []
    for title, measure in QUANTITIES:
        curves = [_curve(label, index, points, measure, over_seconds) for label, index, points in runs]
        known = tuple(curve for curve in curves if curve.xs)
        if known:
            charts.append(Chart(title.format(nouns=nouns), "seconds" if over_seconds else "steps", known))
    return charts


def _curve(label: str, index: int, points: Sequence[CurvePoint], measure: Measure, over_seconds: bool) -> Curve:
    """Without points at which the picture was perfect, or that know no such value."""
    pairs = [(point.seconds if over_seconds else point.step, measure(point)) for point in points]
    kept = [(float(x), float(y)) for x, y in pairs if y is not None and drawable(x) and drawable(y)]
    return Curve(label, index, tuple(x for x, _ in kept), tuple(y for _, y in kept))


def drawable(number: int | float) -> bool:
    """Whether a chart can hold it: perfect pictures and damaged reports have numbers that none can."""
    return abs(number) <= LARGEST


def drawn(chart: Chart) -> Html:
    """The chart as SVG; colours are the style sheet's classes c0, c1, ..."""
    xs = [x for curve in chart.curves for x in curve.xs]
    ys = [y for curve in chart.curves for y in curve.ys]
    first, last = (min(xs), max(xs)) if chart.names else (0.0, max(xs))
    low, high = min(ys), max(ys)
    room = ROOM * (high - low) if high - low > LEAST_RANGE else max(abs(high) * 0.01, 1e-3)
    low, high = low - room, high + room
    span = last - first if abs(last - first) > LEAST_RANGE else 1.0
    last = first + span

    def across(x: float) -> float:
        return LEFT + (x - first) / span * (WIDTH - LEFT - RIGHT)

    def down(y: float) -> float:
        return HEIGHT - BOTTOM - (y - low) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = [element("text", chart.title, x=0, y=14, class_="title")]
    for value in ticks(low, high):
        parts.append(element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=down(value), y2=down(value), class_="grid"))
        parts.append(element("text", f"{value:g}", x=LEFT - 6, y=down(value) + NUMBER_DROP, class_="down"))
    for place in () if chart.names else ticks(first, last):
        parts.append(element("text", _short(place), x=across(place), y=HEIGHT - BOTTOM + 16, class_="across"))
    parts.append(element("text", chart.x_name, x=WIDTH - RIGHT, y=HEIGHT - 1, class_="down"))
    parts += [_line(curve, across, down, chart.dotted) for curve in chart.curves]
    # What the script needs to find the values under the pointer.
    frame = {"left": LEFT, "right": WIDTH - RIGHT, "top": TOP, "bottom": HEIGHT - BOTTOM}
    scale = {
        "first": first,
        "span": span,
        "low": low,
        "high": high,
        "x": chart.x_name,
        "names": list(map(visible, chart.names)),
    }
    return element(
        "svg",
        *parts,
        class_="chart",
        viewBox=f"0 0 {WIDTH} {HEIGHT}",
        role="img",
        aria_label=f"{chart.title}, over {chart.x_name}",
        data_frame=json.dumps(frame | scale),
    )


def _line(curve: Curve, across: Callable[[float], float], down: Callable[[float], float], dotted: bool) -> Html:
    points = [(round(across(x), 1), round(down(y), 1)) for x, y in zip(curve.xs, curve.ys, strict=True)]
    kind = f"c{curve.index % COLORS}" + (" again" if curve.index >= COLORS else "")
    values = json.dumps([[round(x, 3), float(f"{y:.5g}")] for x, y in zip(curve.xs, curve.ys, strict=True)])
    way = "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
    dots = [element("circle", cx=x, cy=y, r=3) for x, y in points] if dotted or len(points) == 1 else []
    line = element("path", d=way, class_="faint" if dotted else "line")
    return element("g", line, joined(dots), class_=kind, data_label=curve.label, data_values=values)


def _short(number: float) -> str:
    """ "500", "1k", "30k"."""
    return f"{number / 1000:g}k" if number >= 1000 else f"{number:g}"
