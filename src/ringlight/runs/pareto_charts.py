"""The picture of ``study pareto``: what each method reaches, over its megabytes and over its core seconds."""

from collections.abc import Sequence
from typing import Literal

from PIL import Image

from ringlight.measure.curves import Chart, Dot, Line, draw_charts, stacked
from ringlight.measure.study_table import StudyRow
from ringlight.methods.variant import Variant

MEASURES = {"psnr": "PSNR, dB", "ssim": "SSIM", "lpips_alex": "LPIPS"}
"""What is shown of a row, and how it is called; a chart each, where the runs have it."""

COSTS: dict[Literal["size", "length"], tuple[str, str]] = {
    "size": ("raw_megabytes", "raw MB"),
    "length": ("core_seconds", "core seconds of training"),
}
"""What the dots of a curve lie over: the row's measure, and how it is called."""

HALVED = 2.0
"""Sizes and lengths are halved from dot to dot, so that the axis shows ratios."""


def pareto_picture(variants: Sequence[Variant], rows: Sequence[StudyRow], title: str) -> Image.Image:
    """Three charts for each scene and each cost; of ``rows`` there is at least one."""
    pictures = []
    for scene in dict.fromkeys(row.scene for row in rows):
        by_name = {row.variant: row for row in rows if row.scene == scene}
        for along, (_, cost) in COSTS.items():
            charts = [chart for measure in MEASURES if (chart := _chart(variants, by_name, along, measure)) is not None]
            if charts:
                pictures.append(draw_charts(charts, f"{title}: {scene}, over {cost}"))
    return stacked(pictures)


def _chart(
    variants: Sequence[Variant], rows: dict[str, StudyRow], along: Literal["size", "length"], measure: str
) -> Chart | None:
    """A line for each method that has dots with this measure; None where none has."""
    dots: dict[str, list[Dot]] = {}
    price, _ = COSTS[along]
    for variant in variants:
        row = rows.get(variant.name)
        value, paid = getattr(row, measure, None), getattr(row, price, None)
        for curve in variant.curves:
            if value is not None and paid is not None and curve.along == along:
                dots.setdefault(curve.name, []).append(Dot(paid.mean, value.mean, value.deviation))
    lines = tuple(Line(name, tuple(found)) for name, found in dots.items())
    return Chart(MEASURES[measure], lines, wide=HALVED) if lines else None
