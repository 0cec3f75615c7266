"""3dgs-dr: what its reflection starts from, and that it is learned."""

from dataclasses import replace

import pytest
import torch

from contracts.methods import small
from ringlight.core.gradients import COLUMNS
from ringlight.errors import RecipeError
from ringlight.fit.strategies.propagate_normals import PropagateNormals
from ringlight.fit.train import Training, train
from ringlight.methods.surface_start import FEWEST_VIEWS
from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS = 12
SCENE = tiny_scene(views=4, size=24)
STRENGTHS, TEXELS = COLUMNS + "reflection_logits", "shader.texels"


def built(**settings: object) -> tuple[Training, SplatModel]:
    recipe = replace(small("3dgs-dr", STEPS), **settings)  # type: ignore[arg-type]
    training: Training = recipe.build(SCENE, rasterizer_for("auto"), 3)
    splats = training.model.splats()
    assert splats is not None
    return training, splats


@pytest.mark.parametrize(("strength", "texels"), [(0.001, 5.0), (0.4, 0.25), (0.9, 0.0)])
def test_the_reflection_starts_as_strong_and_as_grey_as_asked_for(strength: float, texels: float):
    _, model = built(first_strength=strength, first_texels=texels, environment_side=8)
    strengths = model.get_parameter(STRENGTHS).sigmoid()
    torch.testing.assert_close(strengths, torch.full_like(strengths, strength))
    logits = model.get_parameter(TEXELS)
    assert logits.shape == (6, 8, 8, 3)
    assert texels * 0.95 <= logits.abs().max().item() <= texels


def test_strengths_and_environment_are_learned():
    training, model = built()
    before = {name: model.get_parameter(name).detach().clone() for name in (STRENGTHS, TEXELS)}
    for progress in train(training):
        assert progress.fault is None
    for name, first in before.items():
        assert not torch.equal(model.get_parameter(name), first), name


def test_rounds_of_propagation_come_only_if_asked_for():
    recipe = ThreeDGSDRRecipe(steps=7000, warmup=0.05)
    assert not recipe.propagation.rounds(recipe.first_lit, recipe.steps)
    asked = replace(recipe.propagation, until=0.5)
    assert asked.rounds(recipe.first_lit, recipe.steps) == (1350, 2350, 3350)


def test_what_a_round_would_do_decides_nothing_where_there_is_none():
    recipe = ThreeDGSDRRecipe(steps=7000)
    reason = "no round comes until 0 of the run, 1,000 steps after the reflection is on"
    assert recipe.without_effect()["propagation.opacity"] == recipe.without_effect()["propagation.until"] == reason
    asked = replace(recipe, propagation=replace(recipe.propagation, until=0.5))
    assert not any(name.startswith("propagation") for name in asked.without_effect())


def test_noise_is_of_the_runs_seed_and_resets_of_its_density_control():
    recipe = small("3dgs-dr", STEPS)
    for kind, resets in (("adaptive", True), ("mcmc", False)):
        asked = replace(recipe, densify=replace(recipe.densify, kind=kind, reset_every=2, in_proportion=False))
        *_, last = asked.build(SCENE, rasterizer_for("auto"), 7).strategies
        assert isinstance(last, PropagateNormals)
        assert last.seed == 7
        assert last.resets(2) is resets


@pytest.mark.parametrize(("steps", "unlit"), [(10, 1), (1_000, 50), (3_000, 150), (7_000, 150), (30_000, 150)])
def test_normals_of_a_hull_wait_for_the_reflection_for_150_steps_at_most(steps: int, unlit: int):
    usual = ThreeDGSDRRecipe(steps=steps)
    decided = usual.at_length()
    assert decided.first_lit == usual.first_lit == unlit
    assert decided.at_length() == decided
    assert usual.may_settle_on(decided)
    assert not usual.may_settle_on(replace(decided, warmup=0.3))
    assert replace(usual, warmup=0.5).at_length().first_lit == steps // 2


def test_from_points_that_have_no_normals_they_wait_as_in_the_paper():
    scene, usual = tiny_scene(views=FEWEST_VIEWS, size=24), ThreeDGSDRRecipe(steps=7_000)
    few = replace(scene, train=scene.train[:-1])
    from_points = replace(usual, start=replace(usual.start, points=0))
    for recipe, photographs, unlit in ((usual, scene, 150), (usual, few, 350), (from_points, scene, 350)):
        settled, _ = recipe.settled(photographs, rasterizer_for("auto"), 0)
        assert settled.first_lit == unlit
        assert recipe.may_settle_on(settled)
    asked = replace(from_points, warmup=0.02)
    assert asked.settled(scene, rasterizer_for("auto"), 0)[0].warmup == 0.02


@pytest.mark.parametrize("wrong", [{"first_strength": 0.0}, {"first_strength": 1.0}, {"first_texels": -0.1},
                                   {"first_texels": float("nan")}])  # fmt: skip
def test_starts_that_mean_nothing_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=next(iter(wrong))):
        ThreeDGSDRRecipe(**wrong)  # type: ignore[arg-type]
