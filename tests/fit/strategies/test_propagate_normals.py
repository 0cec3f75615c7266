"""Rounds of normal propagation, and when they come."""

import math
from dataclasses import replace

import pytest
import torch

from contracts.methods import small
from ringlight.color.reflective_harmonics import FIRST_STRENGTH
from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.propagate_normals import PropagateNormals
from ringlight.fit.strategies.propagation_settings import PropagationSettings
from ringlight.fit.train import Training, train
from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.methods.warmup import WARMUP
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

SETTINGS = PropagationSettings()


def after_round(strength: float, resets: bool = False) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    """All columns before and after a round, of Gaussians with this strength."""
    training: Training = small("3dgs-dr", 4).build(tiny_scene(views=4, size=16), rasterizer_for("auto"), 3)
    prediction = next(train(training)).prediction
    model, optimizer = training.model, training.optimizer
    logit = math.log(strength / (1 - strength))
    optimizer.replace("columns.reflection_logits", torch.full_like(model.columns["reflection_logits"], logit))
    scales = model.columns["log_scales"].detach() + torch.tensor([0.0, 0.2, -0.3])
    optimizer.replace("columns.log_scales", scales)
    before = {name: column.detach().clone() for name, column in model.columns.items()}
    PropagateNormals(SETTINGS, {7}, lambda step: resets, seed=1).update(7, model, optimizer, prediction)
    return before, {name: column.detach() for name, column in model.columns.items()}


def test_reflective_gaussians_grow_but_for_the_shortest_axis():
    before, after = after_round(0.5)
    grown = (after["log_scales"] - before["log_scales"]).exp()
    torch.testing.assert_close(grown, torch.tensor([1.5, 1.5, 1.0]).expand_as(grown))
    assert torch.equal(after["sh_dc"], before["sh_dc"])
    assert float(after["opacity_logits"].sigmoid().min()) >= SETTINGS.opacity - 1e-6


def test_dull_gaussians_get_noise_on_their_colour_and_keep_their_size():
    before, after = after_round(0.01)
    moved = (after["sh_dc"] - before["sh_dc"]).abs()
    assert 0 < float(moved.max()) <= SETTINGS.sabotage + 1e-6
    assert torch.equal(after["log_scales"], before["log_scales"])


def test_where_opacities_are_reset_no_strength_is_lost_and_there_is_no_round():
    before, after = after_round(1e-5, resets=True)
    torch.testing.assert_close(after["reflection_logits"].sigmoid(), torch.full((len(after["means"]),), FIRST_STRENGTH))
    assert torch.equal(after["sh_dc"], before["sh_dc"])
    assert torch.equal(after["opacity_logits"], before["opacity_logits"])


def test_the_papers_rounds_and_spans():
    assert SETTINGS.rounds(3000, 61_000)[:2] == (4000, 5000)
    assert SETTINGS.held((4000,), 61_000) == ((4001, 4200),)
    assert SETTINGS.rounds(600, 12_000) == (1600, 2600, 3600, 4600, 5600)


def test_a_frozen_parameter_stays_and_then_goes_on():
    group = Adam(Rate.constant(0.1), frozen=((3, 5), (9, 9)))
    assert [step for step in range(1, 11) if not group.moves(step)] == [3, 4, 5, 9]


@pytest.mark.parametrize(
    "wrong", [{"until": 1.5}, {"opacity": 1.0}, {"enlarge": 0.5}, {"every": 0}, {"sabotage": -1.0}]
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=f"propagation.{next(iter(wrong))}"):
        PropagationSettings(**wrong)


def test_the_papers_warm_up_at_the_papers_length_and_the_degrees_before_or_after_it():
    recipe = ThreeDGSDRRecipe(steps=61_000, warmup=WARMUP)  # as from points
    assert abs(recipe.first_lit - 3000) < 100
    assert list(recipe.degrees.values()) == [1, 2, 3]
    assert min(recipe.degrees) < max(recipe.degrees) < recipe.first_lit
    late = replace(recipe, sh_from=0.6)
    assert list(late.degrees.values()) == [1, 2, 3]
    assert recipe.first_lit < min(late.degrees) < max(late.degrees) < recipe.steps


def test_strengths_learn_faster_in_short_runs():
    rates = [ThreeDGSDRRecipe(steps=steps).at_length().reflection_rate for steps in (1000, 15_000, 30_000, 61_000)]
    assert rates == [0.05, 0.012, 0.006, 0.006]
    assert ThreeDGSDRRecipe(steps=1000, reflection_rate=0.01).at_length().reflection_rate == 0.01
