"""Means and spreads of a study, by hand; the table in every form; the charts."""

import csv
import io
from dataclasses import replace

import pytest
from rich.console import Console
from samples import sample_report

from ringlight.measure.curves import Chart, Dot, Line, draw_charts, ticks
from ringlight.measure.study_table import ALL_SCENES, Label, StudyTable, shared_parameters, study_rows

PARTS = {"columns.means": 12, "color.ring": 4000, "color.shading": 800, "color.box": 24, "color.lit": 1}


def of(psnr: float, **fields: object):  # type: ignore[no-untyped-def]
    return replace(sample_report(), psnr=psnr, bytes_by_part=PARTS, **fields)


LABELS = (Label("full", "unchanged", paper=29.01), Label("mlp", "one network"))
RESULTS = {
    "car": {"full": {0: of(30.0), 1: of(31.0)}, "mlp": {0: of(28.0), 1: of(28.0)}},
    "ball": {"full": {0: of(20.0), 1: of(23.0)}, "mlp": {0: of(18.0)}},
}


def test_mean_and_spread_are_over_seeds() -> None:
    rows = {(row.scene, row.variant): row for row in study_rows(LABELS, RESULTS)}
    full = rows["car", "full"]
    assert full.psnr.mean == 30.5
    assert full.psnr.deviation == pytest.approx(0.5**0.5)
    assert rows["car", "mlp"].psnr.deviation == 0
    assert (rows["ball", "mlp"].seeds, rows["ball", "mlp"].psnr.deviation) == (1, None)
    # Over scenes first, seed by seed: (30 + 20) / 2 and (31 + 23) / 2.
    both = rows[ALL_SCENES, "full"]
    assert both.psnr.mean == 26
    assert both.psnr.deviation == pytest.approx(2**0.5)
    assert (ALL_SCENES, "mlp") not in rows, "other seeds on one scene"
    assert len(rows) == 5


def test_a_single_scene_has_no_mean_over_scenes() -> None:
    assert {row.scene for row in study_rows(LABELS, {"car": RESULTS["car"]})} == {"car"}


def test_shared_parameters_are_what_gaussians_share() -> None:
    assert shared_parameters(of(1.0)) == (4000 + 800) // 4


def test_lpips_is_left_out_unless_all_have_it() -> None:
    both = {"car": {"full": {0: of(1.0, lpips_alex=0.25), 1: of(2.0, lpips_alex=0.75)}}}
    assert study_rows(LABELS, both)[0].lpips_alex.mean == 0.5
    some = {"car": {"full": {0: of(1.0, lpips_alex=0.25), 1: of(2.0, lpips_alex=None)}}}
    assert study_rows(LABELS, some)[0].lpips_alex is None


@pytest.mark.parametrize("width", [60, 80, 200, 300])
def test_what_stands_below_a_table_is_of_columns_that_are_shown(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    console.print(StudyTable(study_rows(LABELS, RESULTS)))
    shown = " ".join(console.file.getvalue().split())
    assert ("* PSNR that the paper reports" in shown) == (" paper* " in shown)
    assert ("far: PSNR on the third" in shown) == (" far " in shown.partition("far: PSNR")[0])


@pytest.mark.parametrize("width", [60, 80, 100, 120, 150, 200])
def test_numbers_are_never_cut(width: int) -> None:
    table = StudyTable(study_rows(LABELS, RESULTS))
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(table)
    shown = console.export_text()
    assert "30.50 ± 0.71" in shown
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= width
    if width >= 150:
        assert "1,200" in shown
        assert "29.01" in shown


def test_markdown_and_csv_hold_every_row() -> None:
    rows = study_rows(LABELS, RESULTS)
    text = StudyTable(rows).markdown()
    assert text.count("| full |") == 3
    assert "| full | unchanged | 30.50 ± 0.71 | - | - |" in text
    table = list(csv.DictReader(io.StringIO(StudyTable(rows).csv())))
    assert len(table) == len(rows)
    assert float(table[0]["psnr"]) == 30.5
    assert float(table[0]["psnr_deviation"]) == pytest.approx(0.5**0.5)
    assert table[3]["psnr_deviation"] == "", "one seed has no spread"
    assert table[1]["paper"] == ""


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0.0, 5.0, [0, 1, 2, 3, 4, 5]), (9.7, 10.2, [9.7, 9.8, 9.9, 10.0, 10.1, 10.2]), (3.0, 3.0, [3.0])],
)
def test_ticks_are_round_numbers(low: float, high: float, expected: list[float]) -> None:
    assert ticks(low, high) == pytest.approx(expected)


def test_dots_lie_where_their_values_are() -> None:
    """A larger value is drawn higher, a larger number further right; the line's colour is found in the picture."""
    chart = Chart("PSNR", (Line("car", (Dot(4.0, 20.0), Dot(8.0, 30.0, 1.0), Dot(16.0, 25.0))),))
    picture = draw_charts([chart], "rank")
    color = (0x0B, 0x5F, 0xA5)
    pixels = [(x, y) for x in range(picture.width) for y in range(picture.height) if picture.getpixel((x, y)) == color]
    legend = [y for _, y in pixels if y > picture.height - 40]
    assert legend
    drawn = [(x, y) for x, y in pixels if y <= picture.height - 40]
    left, right = min(drawn), max(drawn)
    top = min(drawn, key=lambda place: place[1])
    assert left[0] < top[0] < right[0]
    assert top[1] < right[1] < left[1], "30 above 25 above 20"


def test_a_wide_range_is_shown_in_decades() -> None:
    """Neighbours at equal ratios are equally far apart."""
    chart = Chart("PSNR", (Line("car", (Dot(1.0, 20.0), Dot(100.0, 30.0), Dot(10_000.0, 20.0))),))
    picture = draw_charts([chart], "gamma")
    color = (0x0B, 0x5F, 0xA5)
    places = [
        (x, y) for x in range(picture.width) for y in range(picture.height - 40) if picture.getpixel((x, y)) == color
    ]
    top = min(places, key=lambda place: place[1])[0]
    assert top == pytest.approx((min(places)[0] + max(places)[0]) / 2, abs=3)


def test_rows_of_dots_have_a_name_each() -> None:
    lines = (Line("car", (Dot(0.0, 20.0, 0.1), Dot(1.0, 21.0))), Line("ball", (Dot(0.0, 25.0), Dot(1.0, 26.0))))
    one = draw_charts([Chart("PSNR", lines, ("full", "mlp"))], "ablation")
    three = draw_charts([Chart("PSNR", lines, ("full", "mlp"))] * 3, "ablation")
    assert three.width == 3 * one.width
    assert three.height == one.height


def test_a_single_value_can_be_drawn() -> None:
    assert draw_charts([Chart("PSNR", (Line("car", (Dot(4.0, 20.0),)),))], "rank").height > 100


def test_a_picture_without_error_ends_neither_table_nor_charts() -> None:
    """Its PSNR is infinite."""
    exact = {"car": {"full": {0: of(float("inf")), 1: of(31.0)}, "mlp": {0: of(28.0), 1: of(28.0)}}}
    table = StudyTable(study_rows(LABELS, exact))
    assert table.rows[0].psnr.deviation is None
    assert "inf" in table.markdown()
    assert table.csv()
    rows = [Dot(0.0, float("inf")), Dot(1.0, 21.0)]
    for names in ((), ("full", "mlp")):
        assert draw_charts([Chart("PSNR", (Line("car", tuple(rows)),), names)], "ablation").height > 100
        assert draw_charts([Chart("PSNR", (Line("car", (rows[0],)),), names)], "ablation").height > 100
