"""The benchmark draws what it says: its two passes are the contract's."""

from ringlight.bench.raster import OneView, bench_raster
from ringlight.bench.timing import Budget
from ringlight.bench.workload import Size, workload
from ringlight.rasterize.choose import rasterizer_for

TINY = Size(300, 24)
ONE_ROUND = Budget(rounds=1, seconds=0.0)


def test_rows_tell_size_and_what_was_visible():
    (row,) = bench_raster([TINY], rasterizer_for("cpu"), ONE_ROUND)
    assert row.size == TINY
    assert 0 < row.visible <= TINY.gaussians
    assert row.passes.both.wall_ms > 0
    assert row.pairs is not None
    assert 0 < row.pairs.blended <= row.pairs.evaluated
    assert row.gflops is not None
    assert row.gflops > 0


def test_work_is_counted_only_for_the_rasterizer_that_can_tell():
    (row,) = bench_raster([Size(20, 8)], rasterizer_for("reference"), ONE_ROUND)
    assert row.pairs is None
    assert row.gflops is None


def test_gradients_are_those_of_the_geometry():
    view = OneView(workload(TINY), rasterizer_for("cpu"))
    view.forward()
    view.backward()
    columns = {f"columns.{name}": column for name, column in view.gaussians.columns().items()}
    assert view.gradients.keys() == columns.keys()
    for name, gradient in view.gradients.items():
        assert gradient.shape == columns[name].shape
        assert gradient.isfinite().all()
        assert gradient.any()
