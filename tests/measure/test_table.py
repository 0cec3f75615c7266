"""The results table: whole numbers at any width, the best marked, differences from the baseline."""

import dataclasses
import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from samples import NO_LPIPS, sample_report

from ringlight.measure.table import ResultsTable

RUNS = (
    ("3dgs", sample_report()),
    ("ringlight", sample_report(psnr=25.9, ssim_same=0.931, bytes_raw=950_000, counted=10_000, fps=55.04)),
    ("3dgs", sample_report(scene="carpaint_200", psnr=24.42)),
    ("ringlight", sample_report(scene="carpaint_200", psnr=25.95)),
)


def printed(table: ResultsTable, width: int, **options) -> str:
    text = io.StringIO()
    Console(file=text, width=width, **options).print(table)
    return text.getvalue()


@pytest.mark.parametrize("width", [40, 60, 80, 100, 120, 200])
def test_it_fits_and_no_number_is_cut(width):
    lines = printed(ResultsTable(RUNS, "3dgs"), width).splitlines()
    assert max(map(len, lines)) <= width
    rows = [line.split() for line in lines if line.startswith(("3dgs ", "ringlight "))]
    assert len(rows) == 4
    psnr = lines[0].split().index("PSNR")
    assert [row[psnr] for row in rows] == ["22.13", "25.90", "24.42", "25.95"]


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=4), st.integers(70, 160))
def test_extreme_numbers_stay_whole(values, width):
    runs = [
        (f"run{i}", sample_report(psnr=v if abs(v) < 1e4 else math.copysign(math.inf, v))) for i, v in enumerate(values)
    ]
    rows = [
        line
        for line in printed(ResultsTable(runs, "run0"), width).splitlines()
        if line.startswith("run") and "PSNR" not in line
    ]
    assert [row.split()[1] for row in rows] == [f"{report.psnr:.2f}" for _, report in runs]


def test_eighty_columns_keep_what_matters_and_a_wide_terminal_shows_all():
    narrow = printed(ResultsTable(RUNS[:2], "3dgs"), 80)
    for title in ("PSNR", "dPSNR", "SSIM", "LPIPS", "raw MB", "x raw", "file MB"):
        assert title in narrow
    assert "x raw" in printed(ResultsTable(RUNS, "3dgs"), 80), "beside the names of scenes too"
    left_out = " ".join(narrow.split()).partition("Too narrow here for ")[2]
    assert "dSSIM" in left_out
    assert "a wider terminal or" in left_out
    assert "Too narrow" not in printed(ResultsTable(RUNS[:2], "3dgs"), 400)
    wide = printed(ResultsTable(RUNS[:2], "3dgs"), 160)
    for title in ("dSSIM", "Gaussians", "train", "it/s", "FPS"):
        assert title in wide


def test_missing_lpips_says_how_to_get_it():
    text = printed(ResultsTable(RUNS[:1]), 120)
    assert "unavailable" in text
    assert "LPIPS vgg" not in text
    assert NO_LPIPS in text


def test_where_nobody_asked_for_lpips_it_is_not_called_unavailable():
    off = [(label, dataclasses.replace(report, lpips_note="")) for label, report in RUNS[:2]]
    assert "unavailable" not in printed(ResultsTable(off), 400)
    one = printed(ResultsTable([RUNS[0], off[1]]), 400).splitlines()
    assert ["unavailable" in line for line in one if line.startswith(("3dgs", "ringlight"))] == [True, False]


def test_without_test_views_lpips_is_missing_as_all_else_is():
    bare = sample_report(psnr=None, psnr_u8=None, psnr_pooled=None, ssim_same=None, images=(), lpips_note="")
    text = printed(ResultsTable([("3dgs", bare)]), 120)
    assert "unavailable" not in text
    row = next(line.split() for line in text.splitlines() if line.startswith("3dgs "))
    assert row[1:4] == ["-", "-", "-"]
    both = printed(ResultsTable([("3dgs", bare), ("ringlight", sample_report())]), 120)
    assert both.count("unavailable") == 1 + NO_LPIPS.count("unavailable")


def test_without_test_views_training_psnr_is_shown_however_narrow():
    bare = sample_report(psnr=None, psnr_u8=None, psnr_pooled=None, ssim_same=None, images=(), psnr_train=23.85)
    assert "23.85" in printed(ResultsTable([("3dgs", bare)]), 60)
    narrow = printed(ResultsTable([("3dgs", sample_report(psnr_train=23.85))]), 60)
    assert "PSNR train" not in narrow


def test_the_best_of_each_scene_is_marked_and_ties_are_equal():
    lines = ResultsTable(RUNS, "3dgs").markdown().splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "_200" in line]
    psnr = [row[2] for row in rows]
    assert psnr == ["22.13", "**25.90**", "24.42", "**25.95**"]
    # All runs of carpaint have the same SSIM: nothing stands out.
    assert rows[2][4] == rows[3][4] == "0.8801"


def test_training_psnr_stands_beside_and_is_no_contest():
    runs = [(label, sample_report(psnr_train=value, psnr_thirds=(30.0, 29.0, value))) for label, value in OVERFIT]
    text = ResultsTable(runs).markdown()
    assert "| PSNR train | PSNR far |" in text
    assert "| 31.00 | **31.00** |" in text
    assert "PSNR train" not in ResultsTable(RUNS).markdown(), "no run has it"


OVERFIT = [("a", 31.0), ("b", 30.0)]


def test_differences_are_from_the_baseline_of_the_same_scene():
    lines = ResultsTable(RUNS, "3dgs").markdown().splitlines()
    titles = [cell.strip() for cell in lines[0].strip("|").split("|")]
    rows = [
        dict(zip(titles, (c.strip() for c in line.strip("|").split("|")), strict=True))
        for line in lines
        if "_200" in line
    ]
    assert [row["dPSNR"] for row in rows] == ["-", "+3.77", "-", "+1.53"]
    assert [row["x raw"] for row in rows] == ["-", "0.14", "-", "1.00"]


def test_the_column_of_what_is_counted_is_called_by_its_noun():
    runs = [("a", sample_report(counted=512, noun="voxels")), ("b", sample_report(counted=64, noun="voxels"))]
    table = ResultsTable(runs).markdown()
    assert " voxels |" in table.splitlines()[0]
    assert "| **64** |" in table


def test_what_is_made_of_different_things_has_its_noun_and_does_not_compete():
    runs = [("3dgs", sample_report()), ("grid", sample_report(counted=262_144, noun="voxels"))]
    table = ResultsTable(runs).markdown()
    assert " made of |" in table.splitlines()[0]
    assert "| 28,123 Gaussians |" in table
    assert "| 262,144 voxels |" in table


def test_memory_is_shown_where_a_run_knows_it():
    assert "| 250.00 |" in ResultsTable(RUNS).markdown()
    assert "peak MB" not in ResultsTable([("before", sample_report(peak_bytes=None))]).markdown()


def test_without_a_baseline_there_are_no_differences():
    assert "dPSNR" not in ResultsTable(RUNS).markdown()
    assert "Differences" not in printed(ResultsTable(RUNS), 120)


def test_differences_are_only_spoken_of_where_there_are_some():
    apart = [("3dgs", sample_report()), ("ringlight", sample_report(scene="carpaint_200"))]
    assert "Differences" not in printed(ResultsTable(apart, "3dgs"), 120)
    assert "Differences and ratios are from 3dgs." in printed(ResultsTable(RUNS, "3dgs"), 120)


def test_a_run_that_was_stopped_is_named():
    stopped = sample_report(iterations=177, planned=600, lpips_note="")
    assert ResultsTable([("a", stopped), ("b", sample_report(planned=600, lpips_note=""))]).notes() == (
        "a stopped at step 177 of 600.",
    )


def test_the_lpips_net_is_the_one_most_runs_have():
    alex = sample_report(lpips_alex=0.12, lpips_note="")
    both = sample_report(lpips_alex=0.1, lpips_vgg=0.2, lpips_note="")
    assert "LPIPS alex" in ResultsTable([("a", alex), ("b", both)]).markdown()
    assert "LPIPS vgg" in ResultsTable([("a", both), ("b", both)]).markdown()


def test_a_long_name_is_cut_but_stays_on_one_line():
    text = printed(ResultsTable([("a-very-long-name-of-a-run-that-somebody-chose", sample_report())]), 80)
    assert re.search(r"^a-very-long.*\.\. +22\.13", text, re.MULTILINE)


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0s"), (59.6, "1m00s"), (247, "4m07s"), (7500, "2h05m")])
def test_durations(seconds, text):
    assert text in ResultsTable([("a", sample_report(train_seconds=float(seconds)))]).markdown()


def test_a_light_with_idle_features_is_named_and_no_other():
    shares = {
        "idle": (0.25, 0.04, 0.1), "off": (0.0, 0.0, 0.9), "fine": (0.0, 0.0, 0.2), "harmonics": (None, None, None)
    }  # fmt: skip
    runs = [
        (name, sample_report(saturated_features=saturated, constant_features=constant, hidden_units_off=off))
        for name, (saturated, constant, off) in shares.items()
    ]
    sentence = "idle: 25% of the light's features are saturated and 4% constant."
    notes = ResultsTable(runs).notes()
    other = "off: 90% of the light's hidden units are off."
    assert [note for note in notes if "of the light's" in note] == [sentence, other]
    assert sentence in printed(ResultsTable(runs), 120)
    assert sentence in ResultsTable(runs).markdown()


def test_a_light_that_collapsed_is_told_of():
    happened = "step 700: the light has collapsed; back to step 500"
    runs = [("bad", sample_report(collapses=(happened,))), ("good", sample_report())]
    assert f"bad: {happened}." in ResultsTable(runs).notes()
    assert not any(note.startswith("good:") for note in ResultsTable(runs).notes())
