"""Tables of methods: what shares a cell, what a mean is over, and files that others' parsers read."""

import csv
import io
import re
from dataclasses import replace
from statistics import fmean, stdev

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from rich.console import Console
from samples import sample_report

from ringlight.measure.method_cells import MEASURES, Measured, MethodCells, cells_of
from ringlight.measure.method_table import MethodTable
from ringlight.measure.report import Report

PSNR = MEASURES[0]
LPIPS = next(measure for measure in MEASURES if measure.key == "lpips_alex")


def report(psnr: float, **changes: object) -> Report:
    return sample_report(psnr=psnr, **changes)


def cells(values: dict[tuple[str, str], list[float]], **changes: object) -> MethodCells:
    reports: Measured = {
        key: {seed: report(value, **changes) for seed, value in enumerate(of_seeds)} for key, of_seeds in values.items()
    }
    scenes, methods = (tuple(dict.fromkeys(key[at] for key in values)) for at in (0, 1))
    return cells_of(scenes, methods, range(max(map(len, values.values()))), reports, {})


TWO = {("a_b", "m&1"): [20.0, 21.0], ("a_b", "n"): [22.0, 22.5], ("c", "m&1"): [30.0, 31.0], ("c", "n"): [25.0, 25.5]}


def test_cells_are_means_over_seeds_and_means_are_over_scenes() -> None:
    made = cells(TWO)
    cell = made.cell(PSNR, "a_b", "m&1")
    assert cell is not None
    assert (cell.mean, cell.deviation) == (20.5, pytest.approx(stdev([20, 21])))
    mean = made.mean(PSNR, "m&1")
    assert mean is not None
    assert (mean.mean, mean.deviation) == (25.5, pytest.approx(stdev([25, 26])))


def test_a_mean_is_over_scenes_that_all_methods_have() -> None:
    made = cells({**TWO, ("d", "m&1"): [90.0, 91.0]})
    mean = made.mean(PSNR, "m&1")
    assert made.common_scenes(PSNR) == ("a_b", "c")
    assert mean is not None
    assert mean.mean == fmean([20, 21, 30, 31])
    notes = MethodTable(made).notes()
    assert any("The mean is over a_b, c," in note for note in notes)
    assert any(note == "d, n, seed 0 is missing: it was not run." for note in notes)


def test_a_method_without_any_run_takes_no_mean_from_the_others() -> None:
    made = cells({**TWO, ("c", "unknown"): []})
    means = [made.mean(PSNR, method) for method in made.methods]
    assert [mean and mean.mean for mean in means] == [25.5, fmean([22, 22.5, 25, 25.5]), None]
    assert MethodTable(made).rows(PSNR)[-1][1][-1][0] == "-"


@pytest.mark.parametrize("changes", [{"resolution": "99x99"}, {"iterations": 2999}, {"split": "others"}])
def test_a_run_that_does_not_compare_has_no_cell(changes: dict[str, object]) -> None:
    reports = {("s", "m"): {0: report(20.0)}, ("s", "n"): {0: report(21.0)}, ("s", "o"): {0: report(30.0, **changes)}}
    made = cells_of(("s",), ("m", "n", "o"), (0,), reports, {})
    assert made.cell(PSNR, "s", "o") is None
    assert made.cell(PSNR, "s", "n") is not None
    (note,) = (note for note in made.notes if "left out" in note)
    assert note.startswith("s, o, seed 0 is left out: it has other ")


def test_a_seed_without_lpips_leaves_the_cell_empty() -> None:
    reports = {("s", "m"): {0: report(20.0, lpips_alex=0.1), 1: report(20.0, lpips_alex=None)}}
    assert cells_of(("s",), ("m",), (0, 1), reports, {}).cell(LPIPS, "s", "m") is None


@given(st.lists(st.floats(10, 40), min_size=2, max_size=5))
def test_the_best_is_the_best_as_shown(values: list[float]) -> None:
    made = cells({("s", f"m{at}"): [value] for at, value in enumerate(values)})
    ranks = made.ranks(PSNR, {method: made.cell(PSNR, "s", method) for method in made.methods})
    shown = [round(value, 2) for value in values]
    best = {f"m{at}" for at, value in enumerate(shown) if value == max(shown)}
    assert {name for name, rank in ranks.items() if rank == 1} == (best if len(set(shown)) > 1 else set())


def test_markdown_is_a_table_for_markdown_it() -> None:
    table = MethodTable(cells(TWO))
    tokens = MarkdownIt("commonmark").enable("table").parse(table.markdown())
    tables = [token for token in tokens if token.type == "table_open"]
    assert len(tables) == len(table.cells.shown())
    inline = [token for token in tokens if token.type == "inline"]
    texts = ["".join(child.content for child in token.children or []) for token in inline]
    assert texts[1:4] == ["scene", "m&1", "n"]
    strong = ["".join(c.content for c in t.children or []) for t in inline
              if any(c.type == "strong_open" for c in t.children or [])]  # fmt: skip
    assert "22.25 ± 0.35" in strong
    assert "20.50 ± 0.71" not in strong


def test_latex_is_balanced_and_has_each_number_in_its_column() -> None:
    text = MethodTable(cells(TWO)).latex()
    assert text.count("\\begin{tabular}{lrr}") == text.count("\\end{tabular}") == len(cells(TWO).shown())
    body = text.split("\\midrule")[1].split("\\midrule")[0]
    rows = [[cell.strip() for cell in re.split(r"(?<!\\)&", line.removesuffix("\\\\").strip())]
            for line in body.strip().splitlines()]  # fmt: skip
    assert rows[0] == ["a\\_b", "\\underline{20.50 $\\pm$ 0.71}", "\\textbf{22.25 $\\pm$ 0.35}"]
    assert "m\\&1" in text
    assert not re.search(r"(?<!\\)[%#](?! )", text)
    assert text.count("{") == text.count("}")


def test_csv_has_each_run_in_full() -> None:
    rows = list(csv.DictReader(io.StringIO(MethodTable(cells(TWO)).csv())))
    assert [(row["scene"], row["method"], row["seed"], float(row["psnr"])) for row in rows[:3]] == [
        ("a_b", "m&1", "0", 20.0), ("a_b", "m&1", "1", 21.0), ("a_b", "n", "0", 22.0),
    ]  # fmt: skip
    assert all(row["count"].isdigit() for row in rows), "Gaussians are whole"


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_terminal_of_any_width_has_every_number(width: int) -> None:
    many = {("s", f"method-number-{at}"): [20.0 + at, 20.5 + at] for at in range(7)}
    console = Console(width=width, file=io.StringIO(), force_terminal=False)
    console.print(MethodTable(cells(many)))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    for at in range(7):
        assert f"{20.25 + at:.2f} ± 0.35" in text
        assert f"method-number-{at}" in text


def test_what_numbers_do_not_tell_stands_below() -> None:
    told = {"collapses": ("at step 9 the light collapsed",), "test_views_trained_on": 1, "lpips_note": "No weights."}
    notes = MethodTable(cells({("a", "m"): [20.0]}, **told)).notes()
    assert "a, m, seed 0: at step 9 the light collapsed." in notes
    assert any(note.startswith("a, m, seed 0: it was trained on 1 of the ") for note in notes)
    assert "No weights." in notes


def test_seconds_of_several_machines_are_not_ranked() -> None:
    """Of as many threads they are; other measures are in any case."""
    wall = next(measure for measure in MEASURES if measure.key == "wall_seconds")
    alike = {("a", "m"): {0: report(20.0, train_seconds=9.0)}, ("a", "n"): {0: report(21.0, train_seconds=8.0)}}
    other = replace(alike["a", "n"][0], machine=replace(alike["a", "n"][0].machine, threads=77))
    for reports, ranked in ((alike, True), (alike | {("a", "n"): {0: other}}, False)):
        made = cells_of(("a",), ("m", "n"), (0,), reports, {})
        for measure, expected in ((wall, ranked), (PSNR, True)):
            spreads = {method: made.cell(measure, "a", method) for method in made.methods}
            assert bool(made.ranks(measure, spreads)) is expected
        assert any("several machines" in note for note in MethodTable(made).notes()) is not ranked
