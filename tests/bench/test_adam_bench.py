"""Adam's benchmark compares what is equal."""

import pytest
import torch

from ringlight.bench.adam import GROUP, bench_adam, torch_step
from ringlight.bench.timing import Budget
from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_

ONCE = Budget(rounds=1, seconds=0.0)


@pytest.mark.parametrize("fused", [True, False])
def test_torchs_step_is_ours(fused):
    column, gradient = torch.ones(7, 3), torch.linspace(-1, 1, 21).view(7, 3)
    step = torch_step([column], [gradient], fused=fused)
    step()
    [theirs] = step.__self__.param_groups[0]["params"]
    ours = column.clone()
    adam_([Update(ours, gradient, torch.zeros(7, 3), torch.zeros(7, 3), GROUP, GROUP.rate.start, 1)])
    torch.testing.assert_close(theirs.detach(), ours, rtol=0, atol=1e-6)
    assert torch.equal(column, torch.ones(7, 3))


def test_rows_are_complete():
    small, large = bench_adam((10, 300), ONCE)
    assert (small.gaussians, large.gaussians) == (10, 300)
    assert large.wall_ratio == pytest.approx(large.fused.wall_ms / large.kernel.wall_ms)
    assert large.gigabytes_per_second > 0


def test_numbers_out_of_range_are_refused():
    with pytest.raises(RecipeError, match="0 Gaussians"):
        bench_adam((0,), ONCE)
