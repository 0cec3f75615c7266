"""The shader is timed on a ball of the size that was asked for."""

import pytest

from ringlight.bench.shade import bench_shade
from ringlight.bench.timing import Budget
from ringlight.errors import RecipeError


def test_each_width_gives_a_row():
    rows = bench_shade([8, 16], 500, Budget(rounds=1, seconds=0.0))
    assert [row.hidden for row in rows] == [8, 16]
    assert all(480 <= row.covered <= 520 for row in rows)
    assert all(row.both.wall_ms > 0 and row.nanoseconds_per_pixel > 0 for row in rows)


def test_a_ball_that_does_not_fit_is_refused():
    with pytest.raises(RecipeError, match="cannot cover"):
        bench_shade([8], 200_000, Budget())
