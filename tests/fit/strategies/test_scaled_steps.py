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
    recipe = small("putt", steps=STEPS, coarsest=4, finest=8, **settings)
    return recipe.build(SCENE, rasterizer_for("cpu"), 0)


def test_maps_are_of_the_last_renewal_or_refinement():
    training = training_of()
    [scaled] = [strategy for strategy in training.strategies if isinstance(strategy, ScaledSteps)]
    assert isinstance(scaled, Strategy)
    assert not scaled.state()
    refined = training.optimizer.model.field.levels
    changed, before = [], {}
    for progress in train(training):
        now = scaled.state()
        same = now.keys() == before.keys() and all(torch.equal(now[name], before[name]) for name in now)
        levels = training.model.field.levels
        assert same == (progress.step > 1 and progress.step % RENEWED_EVERY > 0 and levels == refined)
        changed += [] if same else [progress.step]
        before, refined = now, levels
    assert len(changed) > 1 + STEPS // RENEWED_EVERY
    for name, matrix in before.items():
        parameter = training.model.get_parameter(name.split(".", 1)[1])
        assert len(matrix) == parameter.shape[0 if name.startswith("left") else -1]


def test_without_a_share_steps_are_those_of_adam_alone():
    assert not any(isinstance(strategy, ScaledSteps) for strategy in training_of(scaled=0.0).strategies)


def hostile(maps: dict[str, torch.Tensor], change: str) -> dict[str, torch.Tensor]:
    name = next(name for name in maps if ".left." in name)
    kind = name.split(".left.")[0]
    if change == "missing":
        return {other: matrix for other, matrix in maps.items() if other != name}
    if change == "unknown":
        return maps | {f"{kind}.left.nonsense": torch.eye(3), f"{kind}.foo": torch.eye(3)}
    bad = {
        "size": torch.eye(3),
        "type": maps[name].long(),
        "not a number": torch.full_like(maps[name], float("nan")),
    }
    return maps | {name: bad[change]}


@pytest.mark.parametrize("change", ["missing", "unknown", "size", "type", "not a number"])
def test_maps_that_cores_cannot_have_are_refused(change: str):
    training = training_of()
    next(train(training))
    with pytest.raises(ValueError, match="scaled"):
        training_of().restore(hostile(training.state(), change))
