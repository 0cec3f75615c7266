"""The picture of a table of methods: PSNR over megabytes and over CPU seconds, scene by scene."""

from PIL import Image

from ringlight.measure.curves import Chart, Dot, Line, draw_charts, stacked
from ringlight.measure.method_cells import MEASURES, MethodCells

PSNR = next(measure for measure in MEASURES if measure.key == "psnr")
COSTS = tuple(measure for measure in MEASURES if measure.key in ("raw_megabytes", "core_seconds"))
COST_NAMES = {"raw_megabytes": "raw MB", "core_seconds": "CPU seconds of training"}
HALVED = 2.0
"""Beyond this ratio of costs the axis is logarithmic: methods differ by factors."""


def methods_picture(cells: MethodCells, title: str) -> Image.Image | None:
    """Two charts for each scene, a dot for each method; None where nothing has been measured."""
    scenes = [picture for scene in cells.scenes if (picture := _scene(cells, scene, title)) is not None]
    return stacked(scenes) if scenes else None


def _scene(cells: MethodCells, scene: str, title: str) -> Image.Image | None:
    charts = []
    shown = [m for m in cells.methods if all(cells.cell(measure, scene, m) for measure in (PSNR, *COSTS))]
    for cost in COSTS:
        lines = tuple(Line(method, _dots(cells, scene, method, cost.key)) for method in shown)
        charts.append(Chart(f"PSNR, dB, over {COST_NAMES[cost.key]}", lines, wide=HALVED, measured=True))
    return draw_charts(charts, f"{title}: {scene}") if shown else None


def _dots(cells: MethodCells, scene: str, method: str, key: str) -> tuple[Dot, ...]:
    cost = next(measure for measure in COSTS if measure.key == key)
    quality, paid = cells.cell(PSNR, scene, method), cells.cell(cost, scene, method)
    if quality is None or paid is None:
        return ()
    return (Dot(paid.mean, quality.mean, quality.deviation),)
