"""Ratios are of wall and of processor times, to the first method's; tables fit a terminal of 80 characters."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from ringlight.bench.fps import FpsBench, FpsRow
from ringlight.bench.parts import Beside, PartRow, PartsBench
from ringlight.bench.step import StepBench, StepRow
from ringlight.bench.tables import Block, fps_tables, parts_tables, step_tables
from ringlight.bench.timing import Timing
from ringlight.bench.workload import Size

FIRST = Timing(wall_ms=140.0, cpu_ms=110.0, best_ms=109.0)
SECOND = Timing(wall_ms=105.0, cpu_ms=275.0, best_ms=104.0)


def columns(blocks: Iterable[Block]) -> list[list[str]]:
    """Of the first table, of which no cell is cut off."""
    table = next(block for block in blocks if isinstance(block, Table))
    console = Console(width=80)
    with console.capture() as capture:
        console.print(table)
    assert "…" not in capture.get()
    return [[str(cell) for cell in column.cells] for column in table.columns]


def test_steps_have_both_ratios(circumstances):
    rows = (
        StepRow("3dgs", 20, FIRST, {"adam": FIRST}),
        StepRow("ringlight-mirror", 100_000, SECOND, {}),
    )
    found = columns(step_tables(StepBench(circumstances, "a scene", "cpu", "8x8", rows)))
    assert found[-2:] == [["1.00", "0.75"], ["1.00", "2.50"]]


def test_what_stands_beside_a_part_has_a_line_below_it(circumstances):
    others = tuple(Beside(name, SECOND, 0.75, 2.5) for name in ("reference", "torch foreach"))
    parts = (("reflection-wide", others), ("harmonics", ()))
    rows = tuple(
        PartRow(name, Size(300_000, 800), 50_000, FIRST, FIRST, SECOND, FIRST, beside, None) for name, beside in parts
    )
    found = columns(parts_tables(PartsBench(circumstances, rows)))
    assert found[0] == ["reflection-wide", "· show", "· reference", "· torch foreach", "harmonics", "· show"]
    assert found[-3:] == [
        ["2200", "", "", "", "2200", ""],
        ["", "", "0.750", "0.750", "", ""],
        ["", "", "2.50", "2.50", "", ""],
    ]


def test_frames_have_both_ratios_to_the_first_of_their_size(circumstances):
    rows = tuple(
        FpsRow(method, size, 1e3 / time.wall_ms, time.wall_ms / 1e3, time.cpu_ms / 1e3, time.best_ms / 1e3, "a note")
        for size, times in ((Size(100_000, 400), (FIRST, SECOND)), (Size(20_000, 200), (SECOND, FIRST)))
        for method, time in zip(("3dgs", "ringlight-mirror"), times, strict=True)
    )
    found = columns(fps_tables(FpsBench(circumstances, "cpu", rows)))
    assert found[-2:] == [["1.00", "0.75", "1.00", "1.33"], ["1.00", "2.50", "1.00", "0.40"]]
