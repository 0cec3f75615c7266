"""Benchmark records as tables for a terminal of 80 characters or more."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from ringlight.bench.fps import FpsBench
from ringlight.bench.page import PageBench
from ringlight.bench.parts import PartRow, PartsBench
from ringlight.bench.raster import Passes, RasterBench
from ringlight.bench.record import Circumstances
from ringlight.bench.step import StepBench, StepRow
from ringlight.bench.timing import SHORTEST_MS, Timing
from ringlight.core.words import MEGABYTE, counted, numbered

Record = RasterBench | PartsBench | StepBench | FpsBench | PageBench
Block = Table | Text
Cell = str | int | float | None
"""Words, a count, milliseconds, or nothing."""

COMMIT_DIGITS = 10

NAMES = ("page", "size", "part", "stage", "method")
"""Titles of columns that hold words."""


def tables(record: Record) -> Iterator[Block]:
    """What ``ringlight bench`` prints."""
    return TABLES[type(record)](record)


def raster_tables(record: RasterBench) -> Iterator[Block]:
    """Milliseconds a picture, and the work that is in them."""
    now = record.circumstances
    yield from _head(f"rasterizer {record.rasterizer}: milliseconds a picture of the standard workload, medians", now)
    yield _table(
        ("size", "channels", "forward", "backward", "both", "CPU both", "per second"),
        ((row.size.name, row.size.channels, *_passes(row.passes)) for row in record.rows),
    )
    work = [
        (row.size.name, f"{pairs.evaluated / 1e6:.1f}M", f"{pairs.blended / 1e6:.1f}M", f"{gflops:.0f}", *shares)
        for row in record.rows
        if (pairs := row.pairs) and (gflops := row.gflops) is not None
        for shares in [[f"{100 * gflops / peak:.0f}%" for peak in (now.fma_gflops, now.matrix_gflops)]]
    ]
    if work:
        yield Text("pairs of Gaussian and pixel; GFLOP/s of blending in the fastest round", style="bold")
        yield _table(("size", "tried", "blended", "GFLOP/s", "of FMA", "of mm"), work)
    stages = [(row.size.name, *row.stages.values(), sum(row.stages.values())) for row in record.rows if row.stages]
    if stages:
        yield Text("stages by the kernels' own clock, each in its fastest round", style="bold")
        yield _table(("size", *record.rows[0].stages, "sum"), stages)


def _passes(passes: Passes) -> tuple[Cell, ...]:
    both = passes.both
    return passes.forward.wall_ms, passes.backward.wall_ms, both.wall_ms, both.cpu_ms, _rate(both)


def parts_tables(record: PartsBench) -> Iterator[Block]:
    """Milliseconds of each part, and below it of what it was timed beside."""
    yield from _head("parts of a training step, each alone, milliseconds, medians", record.circumstances)
    titles = ("part", "size", "forward", "backward", "both", "CPU", "ns", "times", "CPU")
    yield _table(titles, (line for row in record.rows for line in _lines(row)))
    yield Text("both: as in a training step; ns: its processor time, for a Gaussian or a pixel", style="dim")
    yield Text("show: without gradients, as in rendering; times: those of the part", style="dim")
    for row in record.rows:
        if row.largest_difference is not None:
            yield Text(f"{row.part} {row.size.name}: {row.largest_difference:.0e} from its reference", style="dim")


def _lines(row: PartRow) -> Iterator[tuple[Cell, ...]]:
    passes = (timing.wall_ms if timing else None for timing in (row.forward, row.backward, row.both))
    yield row.part, row.size.name, *passes, row.both.cpu_ms, f"{row.nanoseconds_each:.0f}"
    if row.show is not None:
        yield "· show", None, None, None, row.show.wall_ms, row.show.cpu_ms
    for other in row.beside:
        both, ratios = other.both, (other.wall_ratio, other.cpu_ratio)
        yield f"· {other.name}", None, None, None, both.wall_ms, both.cpu_ms, None, *ratios


def step_tables(record: StepBench) -> Iterator[Block]:
    """Methods side by side, and where the step of each spends its time."""
    yield from _head(f"one training step on {record.scene}, medians", record.circumstances)
    yield Text(f"{record.image}, {record.renderer}, methods in turns", style="dim")
    first = record.rows[0].whole
    rows = (
        (row.method, numbered(row.gaussians, row.noun), *_spent(row.whole), _rate(row.whole), *_times(row.whole, first))
        for row in record.rows
    )
    yield _table(("method", "made of", "ms", "CPU ms", "best", "it/s", "times", "CPU"), rows)
    yield from (_stage_table(row) for row in record.rows)
    yield Text("times: the first method's; stages are timed while the whole step runs", style="dim")


def _stage_table(row: StepRow) -> Table:
    whole = max(row.whole.wall_ms, SHORTEST_MS)
    stages = ((name, t.wall_ms, t.cpu_ms, f"{100 * t.wall_ms / whole:.0f} %") for name, t in row.stages.items())
    table = _table(("stage", "ms", "CPU ms", "share"), stages)
    table.title, table.title_justify = row.method, "left"
    table.add_section()
    table.add_row("whole step", _shown(row.whole.wall_ms), _shown(row.whole.cpu_ms))
    return table


def fps_tables(record: FpsBench) -> Iterator[Block]:
    """Frames a second."""
    title = f"frames per second of the {record.rasterizer} rasterizer, medians over passes"
    yield from _head(title, record.circumstances)
    frames = [
        (row, Timing(1e3 * row.wall_seconds, 1e3 * row.cpu_seconds, 1e3 * row.best_seconds)) for row in record.rows
    ]
    firsts = {row.size.name: frame for row, frame in reversed(frames)}
    rows = (
        (row.size.name, row.method, f"{row.fps:,.1f}", *_spent(frame), *_times(frame, firsts[row.size.name]))
        for row, frame in frames
    )
    yield _table(("size", "method", "FPS", "ms", "CPU ms", "best", "times", "CPU"), rows)
    yield Text("times: the first method's at that size", style="dim")
    yield Text(record.rows[0].note if record.rows else "", style="dim")


def page_tables(record: PageBench) -> Iterator[Block]:
    """What pages cost in a browser, and what a picture reads and writes."""
    yield from _head("shared pages in a browser, milliseconds, medians", record.circumstances)
    yield Text(f"{record.browser}, {record.renderer}", style="dim")
    yield Text(f"sort of {record.sorted:,} depths in a worker: {record.sort_ms:.1f} ms", style="dim")
    sizes = [f"{row.side}x{row.side}" for row in record.rows]
    yield _table(
        ("page", "size", "MB", "first", "worker", "picture", "colours"),
        (
            (
                row.name,
                size,
                f"{row.bytes_page / MEGABYTE:.2f}",
                row.first_ms,
                row.project_ms + row.sort_ms + row.lists_ms,
                row.picture_ms,
                row.recolored_ms,
            )
            for size, row in zip(sizes, record.rows, strict=True)
        ),
    )
    yield Text("worker: projection, sort, lists; colours: the picture with all made anew", style="dim")
    yield _table(
        ("page", "size", "Gaussians", "entries", "a pixel", "MB"),
        (
            (row.name, size, row.seen, row.entries, row.tests_per_pixel, f"{row.bytes_picture / MEGABYTE:.1f}")
            for size, row in zip(sizes, record.rows, strict=True)
        ),
    )
    yield Text("counted: entries of the tiles' lists, those of a pixel; MB moved for a picture", style="dim")


TABLES: dict[type, Callable[[Any], Iterator[Block]]] = {
    RasterBench: raster_tables,
    PartsBench: parts_tables,
    StepBench: step_tables,
    FpsBench: fps_tables,
    PageBench: page_tables,
}


def _spent(timing: Timing) -> tuple[float, float, float]:
    return timing.wall_ms, timing.cpu_ms, timing.best_ms


def _rate(timing: Timing) -> str:
    return f"{1e3 / max(timing.wall_ms, SHORTEST_MS):,.0f}"


def _times(timing: Timing, first: Timing) -> tuple[str, str]:
    pairs = (timing.wall_ms, first.wall_ms), (timing.cpu_ms, first.cpu_ms)
    wall, cpu = (f"{ms / max(first_ms, SHORTEST_MS):.2f}" for ms, first_ms in pairs)
    return wall, cpu


def _head(title: str, now: Circumstances) -> Iterator[Text]:
    yield Text(title, style="bold")
    machine, source = now.machine, (now.commit or "installed copy")[:COMMIT_DIGITS]
    size = f"{counted(machine.cores, 'core')}, {counted(machine.threads, 'thread')}"
    yield Text(f"{machine.cpu}: {size}, {machine.isa}; {source}", style="dim")
    peaks = f"multiply-adds {now.fma_gflops:.0f}, matrix product {now.matrix_gflops:.0f} GFLOP/s"
    yield Text(f"peaks in this run: {peaks}, copy {now.copy_gbs:.0f} GB/s", style="dim")
    if now.is_busy:
        yield Text(f"the machine is busy (load {now.load:.1f}): trust CPU times, not wall times", style="yellow")


def _table(titles: Sequence[str], rows: Iterable[Sequence[Cell]]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for title in titles:
        table.add_column(title, justify="left" if title in NAMES else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(_shown(cell) for cell in row))
    return table


def _shown(cell: Cell) -> str:
    """Milliseconds with three significant digits while small: 0.742, 6.35, 13.0, 128."""
    if not isinstance(cell, float):
        return "" if cell is None else f"{cell:,}" if isinstance(cell, int) else cell
    digits = 3 if cell < 1 else 2 if cell < 10 else 1 if cell < 100 else 0
    return f"{cell:.{digits}f}"
