"""The benchmark draws what it says: its two passes are the contract's, and a peer sees the same inputs."""

import pytest

from ringlight.bench.against import against
from ringlight.bench.raster import OurRaster, bench_raster, image_gradient
from ringlight.bench.timing import Budget
from ringlight.bench.workload import Size, workload
from ringlight.errors import BackendError
from ringlight.rasterize.choose import rasterizer_for
from shared_data import shared

TINY = Size(300, 24)
ONE_ROUND = Budget(rounds=1, seconds=0.0)


def test_rows_tell_size_and_what_was_visible():
    (row,) = bench_raster([TINY], rasterizer_for("cpu"), ONE_ROUND)
    assert row.size == TINY
    assert 0 < row.visible <= TINY.gaussians
    assert row.peer is None
    assert row.ours.both.wall_ms > 0


def test_a_peer_that_draws_the_same_differs_by_nothing():
    def ours(work, upstream):
        return OurRaster(work, upstream, rasterizer_for("cpu"))

    (row,) = bench_raster([TINY], rasterizer_for("cpu"), ONE_ROUND, ours)
    assert row.largest_difference == 0
    assert row.wall_ratio > 0
    assert row.cpu_ratio >= 0


def test_kernels_are_set_up_only_for_the_rasterizer_that_is_made_of_them(monkeypatch):
    def refuse(*arguments):
        raise AssertionError("set up for nothing")

    monkeypatch.setattr("ringlight.bench.raster.RasterKernel", refuse)
    (row,) = bench_raster([Size(20, 8)], rasterizer_for("reference"), ONE_ROUND)
    assert row.kernels is None
    assert row.pairs is None


def test_gradients_are_those_of_the_geometry():
    work = workload(TINY)
    ours = OurRaster(work, image_gradient(TINY), rasterizer_for("cpu"))
    ours.forward()
    ours.backward()
    columns = {f"columns.{name}": column for name, column in ours.gaussians.columns().items()}
    assert ours.gradients.keys() == columns.keys()
    for name, gradient in ours.gradients.items():
        assert gradient.shape == columns[name].shape
        assert gradient.isfinite().all()
        assert gradient.any()


def test_against_names_what_is_missing(tmp_path):
    with pytest.raises(BackendError, match=r"has no kernel\.cpp"):
        against(tmp_path, 1, "avx2", 3)


def test_against_refuses_widths_that_would_end_the_process(tmp_path):
    with pytest.raises(BackendError, match="not 5"):
        against(tmp_path, 1, "avx2", 5)


@pytest.mark.slow
def test_the_experimental_kernel_draws_the_same_picture():
    peer = against(shared("prototype/raster"), 2, "avx2", 3)
    (row,) = bench_raster([Size(2000, 64)], rasterizer_for("cpu"), ONE_ROUND, peer)
    # Two roundings of alpha near 1/255 may fall on different sides of it.
    assert row.largest_difference < 2 / 255
