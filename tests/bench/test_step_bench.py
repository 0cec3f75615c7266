"""The staged step is the loop's step: the same bits in every parameter; repeating it changes nothing."""

import pytest
import torch
from ringlight.bench.staged_step import StagedStep

from ringlight.bench.step import Photographs, bench_step, subject_of_scene, subject_of_workload
from ringlight.bench.timing import TOTAL, Budget
from ringlight.bench.workload import Size
from ringlight.data.bundled import bundled_scene
from ringlight.errors import RecipeError
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for

TINY = Size(400, 32)


def subject(method):
    return subject_of_workload(method, METHODS[method], TINY, rasterizer_for("cpu"))


@pytest.mark.parametrize("method", ["3dgs", "ringlight-ring", "ringlight-mirror"])
def test_stages_do_what_the_loop_does(method):
    looped, staged = subject(method), subject(method)
    next(train(looped.training))
    for stage in StagedStep(staged.training, staged.step).stages().values():
        stage()
    ours = staged.training.model.state_dict()
    for name, tensor in looped.training.model.state_dict().items():
        assert torch.allclose(tensor, ours[name], rtol=1e-5, atol=1e-7), name


def test_stages_take_a_constant_penalty_as_the_loop_does():
    looped, staged = subject("3dgs"), subject("3dgs")
    for each in (looped, staged):
        each.training.penalties = {"constant": lambda model: torch.ones(())}
    next(train(looped.training))
    for stage in StagedStep(staged.training, staged.step).stages().values():
        stage()
    assert torch.equal(looped.training.model.columns["means"], staged.training.model.columns["means"])


def test_the_workload_has_every_schedule_at_its_end():
    assert int(subject("3dgs").training.model.color.active_degree) == 3
    assert bool(subject("ringlight-ring").training.model.color.lit)


def test_what_a_chooser_settles_on_is_timed():
    assert bool(subject("ringlight").training.model.color.lit)


def test_repeating_leaves_the_training_where_it_was(circumstances):
    before = subject("3dgs")
    (row,) = bench_step([before], Budget(rounds=2, seconds=60.0), circumstances).rows
    assert row.gaussians == TINY.gaussians
    assert set(row.stages) == set(StagedStep(before.training, before.step).stages())
    assert set(row.kernels) == {"raster forward", "loss", "raster backward", "adam", TOTAL}
    assert row.wall_floor_ratio > 0


def test_methods_are_timed_on_one_scene_each_with_its_own_stages(circumstances):
    result = bench_step([subject("3dgs"), subject("ringlight-mirror")], Budget(rounds=1, seconds=60.0), circumstances)
    plain, deferred = result.rows
    assert (plain.method, deferred.method) == ("3dgs", "ringlight-mirror")
    assert result.image == "32x32"
    assert set(deferred.stages) - set(plain.stages) == {"shade forward", "shade backward"}
    assert deferred.wall_floor_ratio > 0


def test_another_rasterizer_has_no_floor(circumstances):
    other = subject_of_workload("3dgs", METHODS["3dgs"], Size(20, 8), rasterizer_for("reference"))
    (row,) = bench_step([other], Budget(rounds=1, seconds=60.0), circumstances).rows
    assert row.kernels == {}
    assert row.wall_floor_ratio is None


def subject_of_photographs(method="3dgs", **asked):
    photographs = Photographs(bundled_scene("toaster"), **asked)
    return subject_of_scene(method, METHODS[method], photographs, rasterizer_for("cpu"), 0)


def test_photographs_can_be_stepped_on_too():
    assert subject_of_photographs(after=1).step == 2
    assert subject_of_photographs(steps=7).training.steps == 7
    with pytest.raises(RecipeError, match="--after is 7; the run has 7 steps"):
        subject_of_photographs(after=7, steps=7)


@pytest.mark.parametrize("method", ["3dgs", "ringlight-mirror"])
def test_on_photographs_methods_can_be_bounded_alike_and_drop_nothing(method):
    bounded = subject_of_photographs(method, steps=2000, gaussians=30_000)
    control, drops = (each for each in bounded.training.strategies if isinstance(each, Densify | DropLeast))
    assert control.settings.max_gaussians == 30_000
    assert drops.rounds == frozenset()


def test_more_gaussians_than_the_bound_are_refused():
    with pytest.raises(RecipeError, match=r"3dgs has .* Gaussians after 0 steps, more than --gaussians 7"):
        subject_of_photographs("3dgs", steps=2000, gaussians=7)


def test_photographs_of_different_sizes_are_refused(circumstances):
    coarse = subject_of_photographs("3dgs", after=1, steps=2000)
    whole = subject_of_photographs("ringlight-mirror", after=1, steps=2000)
    with pytest.raises(RecipeError, match=r"different sizes at that step \(3dgs .*, ringlight-mirror 200x200\)"):
        bench_step([coarse, whole], Budget(rounds=1, seconds=60.0), circumstances)
