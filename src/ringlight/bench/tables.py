"""Benchmark records as tables for a terminal of 80 characters or more."""

from collections.abc import Iterator, Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from ringlight.bench.adam import AdamBench
from ringlight.bench.color import ColorBench
from ringlight.bench.fps import FpsBench
from ringlight.bench.loss import LossBench
from ringlight.bench.raster import RasterBench, RasterRow
from ringlight.bench.record import Circumstances
from ringlight.bench.shade import ShadeBench
from ringlight.bench.step import StepBench, StepRow
from ringlight.bench.timing import SHORTEST_MS

Block = Table | Text

COMMIT_DIGITS = 10

NAMES = ("size", "model", "stage", "method")
"""Titles of columns that hold words."""


def raster_tables(record: RasterBench) -> Iterator[Block]:
    """Milliseconds a frame, and the work that is in them."""
    yield Text(f"rasterizer {record.rasterizer}: milliseconds a frame of the standard workload, medians", style="bold")
    yield from _circumstances(record.circumstances)
    now = record.circumstances
    yield _table_of_passes(record.rows)
    counted = [row for row in record.rows if row.pairs and row.gflops is not None]
    if not counted:
        return
    yield Text("pairs of Gaussian and pixel; GFLOP/s of blending in the fastest round", style="bold")
    table = _table("size", "tried", "blended", "GFLOP/s", "of FMA", "of mm")
    for row in counted:
        if row.pairs and row.gflops is not None:
            pairs = (f"{row.pairs.evaluated / 1e6:.1f}M", f"{row.pairs.blended / 1e6:.1f}M")
            shares = (f"{100 * row.gflops / peak:.0f}%" for peak in (now.fma_gflops, now.matrix_gflops))
            table.add_row(row.size.name, *pairs, f"{row.gflops:.0f}", *shares)
    yield table


def _table_of_passes(rows: Sequence[RasterRow]) -> Table:
    table = _table("size", "channels", "forward", "backward", "both", "CPU both", "per second")
    for row in rows:
        passes = row.passes
        times = (passes.forward.wall_ms, passes.backward.wall_ms, passes.both.wall_ms, passes.both.cpu_ms)
        per_second = f"{1e3 / passes.both.wall_ms:,.0f}"
        table.add_row(row.size.name, str(row.size.channels), *(_ms(time) for time in times), per_second)
    return table


def color_tables(record: ColorBench) -> Iterator[Block]:
    """Milliseconds a view."""
    yield Text("colour of all Gaussians towards one camera, milliseconds, medians", style="bold")
    yield from _circumstances(record.circumstances)
    table = _table("Gaussians", "model", "show", "forward", "backward", "both", "CPU both")
    for row in record.rows:
        times = (row.show.wall_ms, row.forward.wall_ms, row.backward.wall_ms, row.both.wall_ms, row.both.cpu_ms)
        table.add_row(f"{row.gaussians:,}", row.model, *(_ms(time) for time in times))
    yield table
    yield Text("show: without gradients, as in rendering; both: as in a training step", style="dim")


def shade_tables(record: ShadeBench) -> Iterator[Block]:
    """Milliseconds an image."""
    yield Text("reflection shader on a ball, milliseconds, medians", style="bold")
    yield from _circumstances(record.circumstances)
    table = _table("hidden", "pixels", "show", "forward", "backward", "both", "CPU both", "ns a pixel", "reference CPU")
    for row in record.rows:
        times = (row.show.wall_ms, row.forward.wall_ms, row.backward.wall_ms, row.both.wall_ms, row.both.cpu_ms)
        rest = (f"{row.nanoseconds_per_pixel:.0f}", _ms(row.reference.cpu_ms))
        table.add_row(str(row.hidden), f"{row.covered:,}", *(_ms(time) for time in times), *rest)
    yield table
    yield Text("show: without gradients, as in rendering; ns: processor time of both; reference: torch", style="dim")


def loss_tables(record: LossBench) -> Iterator[Block]:
    """Milliseconds an image."""
    yield Text("photometric loss, value and gradient, milliseconds an image, medians", style="bold")
    yield from _circumstances(record.circumstances)
    table = _table("pixels", "kernel", "CPU", "step", "CPU", "reference", "CPU", "ref. : step", "CPU", "max diff")
    for row in record.rows:
        times = (time for timing in (row.kernel, row.step, row.reference) for time in (timing.wall_ms, timing.cpu_ms))
        ratios = (f"{row.wall_ratio:.1f}", f"{row.cpu_ratio:.1f}", f"{row.largest_difference:.0e}")
        table.add_row(f"{row.pixels}x{row.pixels}", *(_ms(time) for time in times), *ratios)
    yield table
    yield Text("kernel: called alone; step: as training calls it; reference: torch, not fast", style="dim")


def adam_tables(record: AdamBench) -> Iterator[Block]:
    """Milliseconds an update."""
    yield Text("one Adam update of a 3dgs table, 59 floats a Gaussian, milliseconds, medians", style="bold")
    yield from _circumstances(record.circumstances)
    table = _table("Gaussians", "kernel", "CPU", "fused", "CPU", "foreach", "CPU", "fused : ours", "CPU", "GB/s")
    for row in record.rows:
        times = (time for timing in (row.kernel, row.fused, row.foreach) for time in (timing.wall_ms, timing.cpu_ms))
        ratios = (f"{row.wall_ratio:.2f}", f"{row.cpu_ratio:.2f}", f"{row.gigabytes_per_second:.0f}")
        table.add_row(f"{row.gaussians:,}", *(_ms(time) for time in times), *ratios)
    yield table
    yield Text("fused, foreach: torch's own, in turns with ours on the same numbers", style="dim")


def step_tables(record: StepBench) -> Iterator[Block]:
    """Methods side by side, and where the step of each spends its time."""
    yield Text(f"one training step on {record.scene}, medians", style="bold")
    yield Text(f"{record.image} pixels, {record.rasterizer} rasterizer, methods in turns", style="dim")
    yield from _circumstances(record.circumstances)
    table = _table("method", "Gaussians", "ms", "CPU ms", "best", "it/s", "times", "CPU")
    first = record.rows[0].whole
    for row in record.rows:
        whole = row.whole
        rate = f"{1e3 / max(whole.wall_ms, SHORTEST_MS):,.0f}"
        times = (_times(whole.wall_ms, first.wall_ms), _times(whole.cpu_ms, first.cpu_ms))
        spent = (_ms(time) for time in (whole.wall_ms, whole.cpu_ms, whole.best_ms))
        table.add_row(row.method, f"{row.gaussians:,}", *spent, rate, *times)
    yield table
    yield from (_stage_table(row) for row in record.rows)
    yield Text("times: the first method's; stages are timed while the whole step runs", style="dim")


def _stage_table(row: StepRow) -> Table:
    table = _table("stage", "ms", "CPU ms", "share")
    table.title, table.title_justify = row.method, "left"
    for name, timing in row.stages.items():
        share = f"{100 * timing.wall_ms / max(row.whole.wall_ms, SHORTEST_MS):.0f} %"
        table.add_row(name, _ms(timing.wall_ms), _ms(timing.cpu_ms), share)
    table.add_section()
    table.add_row("whole step", _ms(row.whole.wall_ms), _ms(row.whole.cpu_ms), "")
    return table


def fps_tables(record: FpsBench) -> Iterator[Block]:
    """Frames a second."""
    yield Text(f"frames per second of the {record.rasterizer} rasterizer, medians over passes", style="bold")
    yield from _circumstances(record.circumstances)
    table = _table("size", "method", "FPS", "ms", "CPU ms", "best", "times", "CPU")
    firsts = {row.size.name: row for row in reversed(record.rows)}
    for row in record.rows:
        first = firsts[row.size.name]
        wall, cpu, best = (1e3 * seconds for seconds in (row.wall_seconds, row.cpu_seconds, row.best_seconds))
        times = (_times(wall, 1e3 * first.wall_seconds), _times(cpu, 1e3 * first.cpu_seconds))
        table.add_row(row.size.name, row.method, f"{row.fps:,.1f}", _ms(wall), _ms(cpu), _ms(best), *times)
    yield table
    yield Text("times: the first method's at that size", style="dim")
    yield Text(record.rows[0].note if record.rows else "", style="dim")


def _times(ms: float, first_ms: float) -> str:
    return f"{ms / max(first_ms, SHORTEST_MS):.2f}"


def _circumstances(now: Circumstances) -> Iterator[Text]:
    machine, source = now.machine, (now.commit or "installed copy")[:COMMIT_DIGITS]
    yield Text(f"{machine.cpu}: {machine.cores} cores, {machine.threads} threads, {machine.isa}; {source}", style="dim")
    peaks = f"multiply-adds {now.fma_gflops:.0f}, matrix product {now.matrix_gflops:.0f} GFLOP/s"
    yield Text(f"peaks in this run: {peaks}, copy {now.copy_gbs:.0f} GB/s", style="dim")
    if now.is_busy:
        yield Text(f"the machine is busy (load {now.load:.1f}): trust CPU times, not wall times", style="yellow")


def _table(*titles: str) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for title in titles:
        table.add_column(title, justify="left" if title in NAMES else "right", no_wrap=True)
    return table


def _ms(milliseconds: float) -> str:
    """Three significant digits while small: 0.742, 6.35, 13.0, 128."""
    digits = 3 if milliseconds < 1 else 2 if milliseconds < 10 else 1 if milliseconds < 100 else 0
    return f"{milliseconds:.{digits}f}"
