"""ringlight-basis: small rows, rates by the length, refusals."""

import dataclasses
import math

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.methods.relight_recipe import relight_recipe
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


@pytest.mark.parametrize("size", [1, 8, 16])
def test_a_gaussian_is_fourteen_numbers_and_its_weights(size: int):
    model = RingLightBasisRecipe(basis_size=size).model(torch.tensor([[-1.0] * 3, [1.0] * 3]), rasterizer_for("auto"))
    rows = [t.shape[1:].numel() for name, t in model.rendering_tensors().items() if name.startswith("columns.")]
    assert sum(rows) == 14 + size


@pytest.mark.parametrize("steps", [1_000, 29_999, 30_000])
def test_base_colours_learn_as_those_of_3dgs_and_fall_in_any_run(steps: int):
    recipes = (dataclasses.replace(METHODS[name], steps=steps) for name in ("ringlight-basis", "3dgs"))
    groups = [recipe.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups for recipe in recipes]
    ours, theirs = (found["columns.sh_dc"].rate for found in groups)
    assert ours.at(0.75) == theirs.at(0.75) == theirs.start
    assert ours.at(1.0) == pytest.approx(ours.start / 10)
    assert (ours == theirs) is (steps < 30_000)


@pytest.mark.parametrize(
    ("steps", "threshold", "share"),
    [(300, 1e-4, 0.7), (7_000, 1e-4, 0.7), (30_000, 2e-4, 0.4), (90_000, 2e-4, 0.4)],
)
def test_long_runs_grow_less_and_drop_less(steps: int, threshold: float, share: float):
    decided = RingLightBasisRecipe(steps=steps).at_length().densify
    assert (decided.threshold, decided.drop_share) == (threshold, pytest.approx(share))


@pytest.mark.parametrize(
    ("steps", "weights", "shared"),
    [
        (300, 5e-3, 1e-2),
        (3_000, 5e-3, 1e-2),
        (7_000, pytest.approx(1.776e-3, rel=1e-3), pytest.approx(3.551e-3, rel=1e-3)),
        (30_000, 3e-4, 6e-4),
        (90_000, 3e-4, 6e-4),
    ],
)
def test_long_runs_learn_what_changes_with_the_view_slowly(steps: int, weights: float, shared: float):
    decided = RingLightBasisRecipe(steps=steps).at_length()
    assert (decided.weights_rate, decided.basis_rate) == (weights, shared)
    between = RingLightBasisRecipe(steps=15_000).at_length()
    assert 3e-4 < (between.weights_rate or 0) < 5e-3
    said = RingLightBasisRecipe(steps=steps, weights_rate=0.0).at_length()
    assert (said.weights_rate, said.basis_rate) == (0.0, shared)
    groups = said.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups
    assert groups["columns.basis_weights"].rate.at(0.0) == 0.0
    assert groups["color.basis"].rate.at(0.0) == shared


def test_growth_in_between_lies_in_between_and_what_the_user_says_holds():
    decided = RingLightBasisRecipe(steps=15_000).at_length().densify
    assert 1e-4 < (decided.threshold or 0) < 2e-4
    assert 0.4 < (decided.drop_share or 0) < 0.7
    assert 0.0 < (decided.drop_hidden or 0) < 0.01
    said = DensifySettings(threshold=3e-5, drop_share=0.25)
    assert said.growth(15_000) == (3e-5, 0.25, 0.0)
    assert RingLightBasisRecipe(steps=15_000, densify=said).at_length().densify.growth(300) == (3e-5, 0.25, 0.0)


@pytest.mark.parametrize(("steps", "share"), [(300, 0.0), (7_000, 0.0), (30_000, 0.01), (90_000, 0.01)])
def test_long_runs_drop_what_lies_hidden(steps: int, share: float):
    assert RingLightBasisRecipe(steps=steps).at_length().densify.drop_hidden == share
    assert dropping_of(RingLightBasisRecipe(steps=steps)).hidden == share


def test_a_long_run_that_is_to_keep_what_lies_hidden_keeps_it():
    recipe = RingLightBasisRecipe(steps=30_000)
    kept = dataclasses.replace(recipe, densify=dataclasses.replace(recipe.densify, drop_hidden=0.0))
    assert dropping_of(kept).hidden == 0.0


def dropping_of(recipe: RingLightBasisRecipe) -> DropLeast:
    strategies = recipe.build(tiny_scene(), rasterizer_for("auto"), 0).strategies
    (dropping,) = [strategy for strategy in strategies if isinstance(strategy, DropLeast)]
    return dropping


def test_without_a_bound_a_photograph_has_seventeen_gaussians_for_twenty_pixels():
    scene = tiny_scene()
    (growing,) = [
        strategy
        for strategy in RingLightBasisRecipe(steps=30_000).build(scene, rasterizer_for("auto"), 0).strategies
        if isinstance(strategy, Densify)
    ]
    assert growing.settings.max_gaussians == math.ceil(0.85 * scene.pixels)


@pytest.mark.parametrize(
    "wrong", [{"basis_size": 0}, {"basis_size": 17}, {"weights_rate": -1.0}, {"basis_rate": float("nan")}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=next(iter(wrong))):
        RingLightBasisRecipe(**wrong)


def test_opacities_learn_four_times_as_fast_as_colours_and_relighting_leaves_them():
    decided = RingLightBasisRecipe(steps=300).at_length()
    assert decided.opacity_basis_rate == 4 * (decided.basis_rate or 0)
    groups = decided.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups
    assert groups["color.opacity_basis"].rate.at(0.0) == decided.opacity_basis_rate
    assert getattr(relight_recipe(decided, 10), "opacity_basis_rate") == 0.0  # noqa: B009


def test_a_recipe_of_before_opacities_varied_says_nothing_of_them():
    before = RingLightBasisRecipe(steps=300, varying_opacity=False)
    assert before.at_length().opacity_basis_rate is None
    relit = relight_recipe(before, 10)
    assert relight_recipe(relit, 10) == relit == dataclasses.replace(relit, opacity_basis_rate=None)
    groups = before.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups
    assert "color.opacity_basis" not in groups


@pytest.mark.parametrize(("steps", "stop", "last"), [(20, 0.5, 10), (3000, 1.0, 3000)])
def test_a_run_without_room_to_drop_says_so(steps: int, stop: float, last: int):
    """Too short, or growing to its end; not one that drops."""
    settings = ("drop_share", "drop_until", "drop_by", "drop_hidden")
    recipe = RingLightBasisRecipe(steps=steps)
    idle = dataclasses.replace(recipe, densify=dataclasses.replace(recipe.densify, stop=stop)).without_effect()
    for name in settings:
        assert f"adds Gaussians until step {last} has no room" in idle[f"densify.{name}"]
    drops = RingLightBasisRecipe(steps=3000).without_effect()
    assert not drops.keys() & {f"densify.{name}" for name in settings}


def test_light_is_learned_from_whole_pictures():
    """Opacities are frozen then, and nobody measured it."""
    assert relight_recipe(dataclasses.replace(RingLightBasisRecipe(), dropout=0.1), 10).dropout == 0
