"""A step that is watched is the loop's step: the same bits in every parameter; repeating it changes nothing."""

import itertools
import time

import pytest
import torch

from ringlight.bench.step import bench_step, subject_of_scene, subject_of_workload
from ringlight.bench.stopwatch import STAGES, Stopwatch
from ringlight.bench.timing import RUNS_A_TURN, WARMUP_ROUNDS, Budget
from ringlight.bench.workload import Size
from ringlight.data.bundled import bundled_scene
from ringlight.errors import RecipeError
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small

TINY = Size(400, 32)

OF_RAYS = {"prediction forward", "prediction backward"}
OF_SPLATS = set(STAGES) - OF_RAYS


def subject(method):
    return subject_of_workload(method, METHODS[method], TINY, rasterizer_for("cpu"))


@pytest.mark.parametrize("method", ["3dgs", "ringlight-ring", "ringlight-mirror"])
def test_who_is_watched_does_what_it_does_alone(method):
    alone, watched = subject(method), subject(method)
    watch = Stopwatch(watched.training)
    for each in (alone, watched):
        next(train(each.training))
    watch.end_round()
    expected, found = alone.training.state(), watched.training.state()
    assert expected.keys() == found.keys()
    assert all(torch.equal(found[name], tensor) for name, tensor in expected.items())


def test_every_watch_sees_its_own_training_alone():
    """Trainings that take turns share a rasterizer."""
    rasterize = rasterizer_for("cpu")
    one, other = (subject_of_workload("3dgs", METHODS["3dgs"], TINY, rasterize) for _ in range(2))
    busy, idle = Stopwatch(one.training), Stopwatch(other.training)
    for _ in range(WARMUP_ROUNDS + RUNS_A_TURN):
        next(train(one.training))
        busy.end_round()
        idle.end_round()
    assert set(busy.timings()) == OF_SPLATS
    assert idle.timings() == {}


def test_the_workload_has_every_schedule_at_its_end():
    assert int(subject("3dgs").training.model.color.active_degree) == 3
    assert bool(subject("ringlight-ring").training.model.color.lit)


def test_repeating_leaves_the_training_where_it_was(circumstances):
    once, repeated = subject("3dgs"), subject("3dgs")
    next(train(once.training))
    (row,) = bench_step([repeated], Budget(rounds=2, seconds=60.0), circumstances).rows
    assert row.gaussians == TINY.gaussians
    assert set(row.stages) == OF_SPLATS
    expected, found = once.training.state(), repeated.training.state()
    assert expected.keys() == found.keys()
    assert all(torch.equal(found[name], tensor) for name, tensor in expected.items())


def test_stages_are_of_the_runs_that_the_whole_step_is_timed_in(circumstances):
    """Those that only wake the machine, which take longer, are in neither."""
    slow = subject("3dgs")
    usual, calls = slow.training.optimizer.step, itertools.count()

    def step(*arguments, **named):
        run = next(calls) - WARMUP_ROUNDS
        if run % RUNS_A_TURN != RUNS_A_TURN - 1:
            time.sleep(0.1)
        return usual(*arguments, **named)

    slow.training.optimizer.step = step
    (row,) = bench_step([slow], Budget(rounds=3, seconds=60.0), circumstances).rows
    assert row.stages["adam"].wall_ms <= row.whole.wall_ms


def test_methods_are_timed_on_one_scene_in_the_same_stages(circumstances):
    result = bench_step([subject("3dgs"), subject("ringlight-mirror")], Budget(rounds=1, seconds=60.0), circumstances)
    plain, deferred = result.rows
    assert (plain.method, deferred.method) == ("3dgs", "ringlight-mirror")
    assert result.image == "32x32 pixels"
    assert set(plain.stages) == set(deferred.stages) == OF_SPLATS


def test_another_rasterizer_has_the_same_stages(circumstances):
    other = subject_of_workload("3dgs", METHODS["3dgs"], Size(20, 8), rasterizer_for("reference"))
    (row,) = bench_step([other], Budget(rounds=1, seconds=60.0), circumstances).rows
    assert set(row.stages) == OF_SPLATS


def subject_of_photographs(method="3dgs", **asked):
    return subject_of_scene(method, METHODS[method], bundled_scene("toaster"), rasterizer_for("cpu"), 0, **asked)


def test_photographs_can_be_stepped_on_too():
    assert subject_of_photographs(after=1).training.step == 1
    assert subject_of_photographs(steps=7).training.steps == 7
    with pytest.raises(RecipeError, match="--after is 7; the run has 7 steps"):
        subject_of_photographs(after=7, steps=7)


@pytest.mark.parametrize("method", ["3dgs", "ringlight-mirror"])
def test_on_photographs_methods_can_be_bounded_alike_and_drop_nothing(method):
    bounded = subject_of_photographs(method, steps=2000, gaussians=30_000)
    assert [strategy.most for strategy in bounded.training.strategies if strategy.most] == [30_000]
    assert not any(getattr(strategy, "rounds", ()) for strategy in bounded.training.strategies)


def test_more_gaussians_than_the_bound_are_refused():
    with pytest.raises(RecipeError, match=r"3dgs has .* Gaussians after 0 steps, more than --gaussians 7"):
        subject_of_photographs("3dgs", steps=2000, gaussians=7)


def test_photographs_of_different_sizes_are_refused(circumstances):
    coarse = subject_of_photographs("3dgs", after=1, steps=2000)
    whole = subject_of_photographs("ringlight-mirror", after=1, steps=2000)
    with pytest.raises(RecipeError, match=r"different sizes at that step \(3dgs .*, ringlight-mirror 200x200 pixels\)"):
        bench_step([coarse, whole], Budget(rounds=1, seconds=60.0), circumstances)


def test_volumes_are_timed_on_photographs_beside_gaussians(circumstances):
    rasterize = rasterizer_for("cpu")
    recipe = small("tensorf", rays=64)
    volume = subject_of_scene("tensorf", recipe, bundled_scene("toaster"), rasterize, 0)
    result = bench_step([volume, subject_of_photographs()], Budget(rounds=1, seconds=60.0), circumstances)
    of_rays, of_splats = result.rows
    assert set(of_rays.stages) >= OF_RAYS | {"adam"}
    assert not OF_RAYS & set(of_splats.stages)
    assert (of_rays.noun, of_splats.noun) == ("voxels", "Gaussians")
    assert of_rays.gaussians == volume.training.model.counted().number
    assert result.image.startswith("a lot of 64 rays, ")


def test_a_volume_has_no_place_in_the_workload():
    with pytest.raises(RecipeError, match=r"tensorf has no Gaussians, .* time its step on a --scene"):
        subject_of_workload("tensorf", small("tensorf"), TINY, rasterizer_for("cpu"))
