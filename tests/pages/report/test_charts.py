"""Charts hold the values, in the place where the axes say."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parsed import Parsed

from ringlight.measure.report import CurvePoint
from ringlight.pages.report.charts import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Chart, Curve, drawn, training_charts

POINTS = [CurvePoint(10 * i, i / 2, 20.0 + i, 1000 * i, 1.0 / i) for i in range(1, 6)]


def test_a_training_has_three_charts() -> None:
    charts = training_charts([("a", 0, POINTS)], "voxels", over_seconds=False)
    assert [chart.title for chart in charts] == [
        "PSNR of training photographs, dB",
        "loss with all its terms",
        "thousand voxels",
    ]
    assert charts[0].curves[0].xs == (10, 20, 30, 40, 50)
    assert charts[1].curves[0].ys == (1, 1 / 2, 1 / 3, 1 / 4, 1 / 5)
    assert training_charts([("a", 0, POINTS)], "", over_seconds=True)[2].curves[0].xs == (0.5, 1, 1.5, 2, 2.5)


def test_runs_that_know_no_loss_have_no_chart_of_it() -> None:
    old = [CurvePoint(1, 0.1, 20.0, 5), CurvePoint(2, 0.2, float("inf"), 6)]
    charts = training_charts([("old", 0, old)], "Gaussians", over_seconds=False)
    assert [len(chart.curves[0].xs) for chart in charts] == [1, 2], "a perfect picture is no point"
    both = training_charts([("old", 0, old), ("new", 1, POINTS)], "Gaussians", over_seconds=False)
    assert [curve.label for curve in both[1].curves] == ["new"]


VALUES = st.lists(st.tuples(st.floats(0, 1e6), st.floats(-1e3, 1e3)), min_size=1, max_size=20)


@settings(max_examples=50)
@given(VALUES, st.text())
def test_lines_stay_inside_the_frame_and_keep_their_values(values: list[tuple[float, float]], label: str) -> None:
    curve = Curve(label, 7, tuple(x for x, _ in values), tuple(y for _, y in values))
    page = Parsed(drawn(Chart("title", "steps", (curve,))))
    [group] = page.all("g")
    assert group["class"] == "c1 again"
    kept = json.loads(group["data-values"] or "")
    assert [x for x, _ in kept] == pytest.approx([x for x, _ in values], abs=1e-3)
    assert [y for _, y in kept] == pytest.approx([y for _, y in values], rel=1e-4)
    [path] = page.all("path")
    for place in (path["d"] or "")[1:].split("L"):
        x, y = map(float, place.split())
        assert LEFT - 0.1 <= x <= WIDTH - RIGHT + 0.1
        assert TOP - 0.1 <= y <= HEIGHT - BOTTOM + 0.1


def test_larger_is_higher_and_later_is_to_the_right() -> None:
    page = Parsed(drawn(Chart("t", "steps", (Curve("a", 0, (0.0, 5.0), (1.0, 2.0)),))))
    (x0, y0), (x1, y1) = (map(float, p.split()) for p in (page.all("path")[0]["d"] or "")[1:].split("L"))
    assert x1 > x0
    assert y1 < y0


@pytest.mark.parametrize("tiny", [5e-324, 1e-310, 1e-20])
def test_a_damaged_reports_smallest_numbers_are_drawn(tiny: float) -> None:
    page = Parsed(drawn(Chart("t", "seconds", (Curve("a", 0, (tiny, 2 * tiny), (0.0, tiny)),))))
    assert len(page.all("path")) == 1


def test_no_name_turns_the_tip() -> None:
    """The page's script shows these names as they are."""
    chart = Chart("t", "worst to best", (Curve("a", 0, (0.0,), (1.0,)),), ("a\u202eb",))
    frame = json.loads(Parsed(drawn(chart)).all("svg")[0]["data-frame"] or "")
    assert frame["names"] == ["a\\u202eb"]
