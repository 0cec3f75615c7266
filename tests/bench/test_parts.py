"""Every part can be timed by name, and what stands beside it does the same work."""

from dataclasses import replace

import pytest
import torch

from in_bfloat16 import IN_BFLOAT16
from ringlight.bench import step_parts
from ringlight.bench.parts import bench_parts
from ringlight.bench.step_parts import BALL_RADIUS, BETAS, EPSILON, PARTS, RATE, torch_step
from ringlight.bench.timing import Budget
from ringlight.bench.workload import Size
from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_
from ringlight.methods.table import METHODS

ONCE = Budget(rounds=1, seconds=0.0)
CPU = torch.device("cpu")


def test_each_part_gives_a_row_for_each_size():
    sizes = [Size(64, 24), Size(128, 17)]
    rows = bench_parts(list(PARTS), sizes, ONCE, 0, CPU)
    assert [(row.size, row.part) for row in rows] == [(size, name) for size in sizes for name in PARTS]
    for row in rows:
        assert row.both.wall_ms > 0
        assert row.nanoseconds_each > 0
        assert (row.forward is None) == (row.backward is None) == (row.part in ("photometric", "adam"))
        for other in row.beside:
            assert other.wall_ratio == pytest.approx(other.both.wall_ms / row.both.wall_ms)


def test_references_agree_with_what_they_are_timed_beside():
    rows = bench_parts(["reflection", "reflection-wide", "photometric"], [Size(1, 40)], ONCE, 0, CPU)
    assert [[other.name for other in row.beside] for row in rows] == [["whole", "reference"]] * 2 + [["reference"]]
    for row in rows:
        assert row.largest_difference < (5e-3 if IN_BFLOAT16 else 1e-4)


def test_parts_are_those_that_the_methods_train(monkeypatch):
    made = []

    def recorded(usual):
        def make(settings, *rest):
            made.append(settings)
            return usual(settings, *rest)

        return make

    for kind in ("RingLight", "ReflectionShader"):
        monkeypatch.setattr(step_parts, kind, recorded(getattr(step_parts, kind)))
    for name in ("ring", "ring-paper", "reflection"):
        PARTS[name](Size(8, 8), 0, CPU)
    ring, paper, mirror = (METHODS[name] for name in ("ringlight-ring", "ringlight-paper", "ringlight-mirror"))
    assert made == [ring.light, paper.light, mirror.shader, replace(mirror.shader, gradient_share=1.0)]


def test_the_ball_covers_the_share_that_it_says():
    covered = PARTS["reflection"](Size(1, 200), 0, CPU).items
    assert covered == pytest.approx(torch.pi * (BALL_RADIUS * 200) ** 2, rel=0.01)


@pytest.mark.parametrize("fused", [True, False])
def test_torchs_step_is_ours(fused):
    column, gradient = torch.ones(7, 3), torch.linspace(-1, 1, 21).view(7, 3)
    step = torch_step([column], [gradient], fused=fused)
    step()
    [theirs] = step.__self__.param_groups[0]["params"]
    ours = column.clone()
    adam_([Update(ours, gradient, torch.zeros(7, 3), torch.zeros(7, 3), (RATE, *BETAS, EPSILON, 1))])
    torch.testing.assert_close(theirs.detach(), ours, rtol=0, atol=1e-6)
    assert torch.equal(column, torch.ones(7, 3))


def test_unknown_parts_are_refused_by_name():
    with pytest.raises(RecipeError, match=r"'shiny'; known: harmonics, basis, ring"):
        bench_parts(["shiny"], [Size(10, 8)], ONCE, 0, CPU)
