"""The rasterizer's stages are told by its own clock."""

import pytest

from ringlight.bench.raster import OneView, bench_raster
from ringlight.bench.timing import Budget
from ringlight.bench.workload import Size, workload
from ringlight.rasterize.choose import rasterizer_for


@pytest.mark.parametrize("rounds", [1, 3])
def test_every_stage_is_timed_in_order(rounds):
    (row,) = bench_raster([Size(500, 48)], rasterizer_for("cpu"), Budget(rounds, 60.0))
    assert list(row.stages) == ["project", "sort", "bin", "blend", "blend_gradient", "project_gradient"]
    assert all(milliseconds > 0 for milliseconds in row.stages.values())


def test_stages_are_of_their_own_size():
    """One rasterizer draws all sizes: what the smaller left is not the larger one's fastest round."""
    rasterize = rasterizer_for("cpu")
    small, large = (OneView(workload(Size(count, 16)), rasterize) for count in (50, 500))
    for passes in (small.forward, small.backward):
        passes()
    assert small.stage_seconds()
    assert large.stage_seconds() == {}


def test_another_rasterizer_has_no_stages():
    (row,) = bench_raster([Size(20, 8)], rasterizer_for("reference"), Budget(1, 0.0))
    assert row.stages == {}
