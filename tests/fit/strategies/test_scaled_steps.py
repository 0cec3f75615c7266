"""Steps of tensor trains are scaled by maps that are renewed every so often, kept in a checkpoint, and can be left."""

import dataclasses

import pytest
import torch

from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.scaled_steps import RENEWED_EVERY, ScaledSteps
from ringlight.fit.train import Training, train
from ringlight.methods.putt import PuttRecipe
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume.tt_directions import STEP_SIZE, InverseRoots, inverse_roots
from ringlight.volume.tt_scaling import Scaling
from small_recipes import small
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=4, size=16)
STEPS = 26
CPU = rasterizer_for("cpu")
CORES = [f"field.{train}_train.cores.{k}" for train in ("density", "appearance") for k in range(3)]
"""After the doubling, which comes after step DOUBLED."""
[DOUBLED] = PuttRecipe(steps=STEPS, coarsest=4, finest=8).refined


def training_of(**settings: float) -> Training:
    recipe = small("putt", steps=STEPS, coarsest=4, finest=8, **{"scaled": 0.6, "scaled_after": 0, **settings})
    return recipe.build(SCENE, CPU, 0)


def begin_of(recipe: PuttRecipe) -> int:
    return scaled_in(recipe.build(SCENE, CPU, 0)).begin


def numbers_of(roots: list[InverseRoots]) -> torch.Tensor:
    return torch.cat([matrix.flatten() for both in roots for matrix in (both.of_left, both.of_right)])


def scaled_in(training: Training) -> ScaledSteps:
    [scaled] = [strategy for strategy in training.strategies if isinstance(strategy, ScaledSteps)]
    return scaled


@pytest.mark.parametrize("orthogonal", [False, True])
def test_maps_are_of_the_last_renewal_or_refinement(orthogonal: bool):
    training = training_of(orthogonal=orthogonal)
    scaled = scaled_in(training)
    assert isinstance(scaled, Strategy)
    assert not len(scaled.state()["maps"])
    refined = training.optimizer.model.field.levels
    changed, before = [], scaled.state()["maps"]
    for progress in train(training):
        now = scaled.state()["maps"]
        same = torch.equal(now, before)
        levels = training.model.field.levels
        assert same == (progress.step > 1 and progress.step % RENEWED_EVERY > 0 and levels == refined)
        changed += [] if same else [progress.step]
        before, refined = now, levels
    assert len(changed) > 1 + STEPS // RENEWED_EVERY


def test_steps_are_scaled_after_the_last_doubling_unless_another_is_asked_for():
    asked_for = small("putt", steps=STEPS, coarsest=4, finest=16)
    training = dataclasses.replace(asked_for, scaled_after=PuttRecipe().scaled_after).build(SCENE, CPU, 0)
    scaled = scaled_in(training)
    for _ in train(training):
        assert (len(scaled.state()["maps"]) > 0) == (training.model.field.levels == 4)
    assert training.model.field.levels == 4
    begins = [begin_of(dataclasses.replace(asked_for, scaled_after=after)) for after in range(4)]
    assert begins == [0, *asked_for.refined, scaled.begin]


def test_of_any_number_of_doublings_the_last_counts():
    many = PuttRecipe(steps=3000, coarsest=4, finest=256, bounds=(-1.0, -1.0, -1.0, 1.0, 1.0, 1.0))
    assert len(many.refined) == 6
    assert begin_of(many) == max(many.refined)
    assert begin_of(dataclasses.replace(many, coarsest=16, finest=16)) == 0


def test_without_a_share_steps_are_those_of_adam_alone():
    assert not any(isinstance(strategy, ScaledSteps) for strategy in training_of(scaled=0.0).strategies)


def test_in_their_bases_steps_along_orthogonal_matrices_have_one_size(monkeypatch: pytest.MonkeyPatch):
    training = training_of(orthogonal=True, average=0.0)
    optimizer, core = training.optimizer, "field.appearance_train.cores.1"
    given: dict[str, Scaling] = {}
    scale = optimizer.scale
    monkeypatch.setattr(optimizer, "scale", lambda maps, directed: (given.update(maps), scale(maps, directed)))
    scaling, before, sizes = None, None, []
    for progress in train(training):
        now = training.model.get_parameter(core).detach().clone()
        if scaling is not None and scaling.right is not None and now.shape == before.shape:
            inner = torch.linalg.solve(scaling.left, (now - before).flatten(1)).view_as(now)
            inner = torch.linalg.solve(scaling.right, inner.flatten(0, 1), left=False)
            sizes.append(inner.square().mean().sqrt().item() / optimizer.rate(core, progress.step))
        scaling, before = given[core], now
    assert len(sizes) > STEPS // 2
    assert sizes == pytest.approx([STEP_SIZE] * len(sizes), rel=1e-2)


@pytest.mark.parametrize(
    ("stopped", "scaled_after"), [(3, 0), (DOUBLED, 0), (14, 0), (25, 0), (3, 1), (DOUBLED, 1), (14, 1)]
)
def test_directed_steps_go_on_bitwise_where_they_stopped(stopped: int, scaled_after: int):
    whole, first, again = (training_of(orthogonal=True, scaled_after=scaled_after) for _ in range(3))
    for _ in train(whole):
        pass
    for progress in train(first):
        if progress.step == stopped:
            break
    again.restore(first.state())
    for _ in train(again):
        pass
    end, state = whole.state(), again.state()
    assert end.keys() == state.keys()
    assert all(torch.equal(tensor, state[name]) for name, tensor in end.items())


def test_what_means_are_multiplied_by_is_made_with_the_maps():
    training = training_of(orthogonal=True, average=0.0)
    scaled, made = scaled_in(training), []
    for progress in train(training):
        if progress.step % RENEWED_EVERY == 0:
            expected = numbers_of([inverse_roots(mean) for mean in training.optimizer.means(CORES).values()])
            made.append(scaled.state()["maps"][-len(expected) :])
            torch.testing.assert_close(made[-1], expected)
    assert training.model.field.levels == 3
    assert len(made) == STEPS // RENEWED_EVERY
    assert not torch.equal(made[0], made[1])


def test_a_run_of_which_maps_alone_were_kept_goes_on_with_them():
    training, again = training_of(orthogonal=True), training_of(orthogonal=True)
    for progress in train(training):
        if progress.step == 14:
            break
    state = training.state()
    [name] = [name for name in state if name.endswith(".maps")]
    made = [inverse_roots(mean) for mean in training.optimizer.means(CORES).values()]
    maps = state[name][: -len(numbers_of(made))]
    again.restore(state | {name: maps})
    restored = again.state()[name]
    assert torch.equal(restored[: len(maps)], maps)
    assert len(restored) == len(state[name])
    torch.testing.assert_close(restored[len(maps) :], numbers_of(made))


@pytest.mark.parametrize("orthogonal", [False, True])
@pytest.mark.parametrize("change", ["shorter", "a number", "of another shape", "of another type", "not a number"])
def test_maps_that_cores_cannot_have_are_refused(change: str, orthogonal: bool):
    training = training_of(orthogonal=orthogonal)
    next(train(training))
    state = training.state()
    [name] = [name for name in state if name.endswith(".maps")]
    maps = state[name]
    spoiled = {
        "shorter": maps[1:],
        "a number": maps[0],
        "of another shape": maps[:, None],
        "of another type": maps.long(),
        "not a number": torch.full_like(maps, float("nan")),
    }
    with pytest.raises(ValueError, match="steps are scaled by"):
        training_of(orthogonal=orthogonal).restore(state | {name: spoiled[change]})
