"""The loss's benchmark compares what is equal."""

import pytest

from ringlight.bench.loss import bench_loss
from ringlight.bench.timing import Budget
from ringlight.errors import RecipeError

ONCE = Budget(rounds=1, seconds=0.0)


def test_our_gradient_and_the_references_agree():
    for row in bench_loss((17, 40), ONCE):
        assert row.largest_difference < 1e-4
        assert row.kernel.wall_ms > 0
        assert row.wall_ratio == pytest.approx(row.reference.wall_ms / row.step.wall_ms)


@pytest.mark.parametrize("pixels", [0, -3, 9000])
def test_sizes_out_of_range_are_refused(pixels):
    with pytest.raises(RecipeError, match="pixels a side"):
        bench_loss((16, pixels), ONCE)
