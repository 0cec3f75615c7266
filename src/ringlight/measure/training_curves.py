"""The picture of ``compare --curves``: how trainings went, over their steps and over their seconds."""

import math
from collections.abc import Callable, Sequence

from PIL import Image

from ringlight.errors import RunError
from ringlight.measure.curves import Chart, Dot, Line, draw_charts, stacked
from ringlight.measure.report import CurvePoint, Report

ALWAYS_LINEAR = math.inf
"""Ratio beyond which an axis is logarithmic: steps and seconds begin near zero."""

Measure = Callable[[CurvePoint], float]


def curves_picture(runs: Sequence[tuple[str, Report]]) -> Image.Image:
    """Three charts for each scene: training PSNR over steps and over seconds, and the model's size over steps.

    A run that does not know how its training went is left out; raises RunError where none does.
    """
    known = [(label, report) for label, report in runs if _finite(report)]
    if not known:
        raise RunError("no run knows how its training went; curves are in reports of runs that this version trained")
    pictures = []
    for scene in dict.fromkeys(report.scene for _, report in known):
        of_scene = [(label, report) for label, report in known if report.scene == scene]
        nouns = " and ".join(dict.fromkeys(report.noun for _, report in of_scene))
        charts = (
            _chart("training PSNR, dB, over steps", of_scene, lambda point: point.step, lambda point: point.psnr),
            _chart("training PSNR, dB, over seconds", of_scene, lambda point: point.seconds, lambda point: point.psnr),
            _chart(
                f"thousand {nouns} over steps", of_scene, lambda point: point.step, lambda point: point.counted / 1e3
            ),
        )
        pictures.append(draw_charts(charts, scene))
    return stacked(pictures)


def _finite(report: Report) -> list[CurvePoint]:
    """Without points at which the picture was perfect."""
    return [point for point in report.curve if math.isfinite(point.psnr) and math.isfinite(point.seconds)]


def _chart(title: str, runs: Sequence[tuple[str, Report]], x: Measure, y: Measure) -> Chart:
    lines = (Line(label, tuple(Dot(float(x(point)), y(point)) for point in _finite(report))) for label, report in runs)
    return Chart(title, tuple(lines), wide=ALWAYS_LINEAR, marked=False)
