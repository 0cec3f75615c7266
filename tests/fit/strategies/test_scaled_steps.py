"""Steps of tensor trains are scaled by maps that are renewed every so often, kept in a checkpoint, and can be left."""

import pytest
import torch

from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.scaled_steps import RENEWED_EVERY, ScaledSteps
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=4, size=16)
STEPS = 26


def training_of(**settings: float) -> Training:
    recipe = small("putt", steps=STEPS, coarsest=4, finest=8, **{"scaled": 0.6, **settings})
    return recipe.build(SCENE, rasterizer_for("cpu"), 0)


def test_maps_are_of_the_last_renewal_or_refinement():
    training = training_of()
    [scaled] = [strategy for strategy in training.strategies if isinstance(strategy, ScaledSteps)]
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


def test_without_a_share_steps_are_those_of_adam_alone():
    assert not any(isinstance(strategy, ScaledSteps) for strategy in training_of(scaled=0.0).strategies)


@pytest.mark.parametrize("change", ["shorter", "a number", "of another shape", "of another type", "not a number"])
def test_maps_that_cores_cannot_have_are_refused(change: str):
    training = training_of()
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
        training_of().restore(state | {name: spoiled[change]})
