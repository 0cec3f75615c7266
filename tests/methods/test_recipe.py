"""Recipes survive JSON; what a file holds instead is refused with the place where it stands."""

import json
from dataclasses import replace

import pytest

from ringlight.data.synthetic import tiny_scene
from ringlight.errors import RecipeError
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for


@pytest.mark.parametrize("preset", METHODS)
def test_json_and_back(preset: str):
    recipe = METHODS[preset]
    assert recipe_from_dict(type(recipe), json.loads(json.dumps(recipe_to_dict(recipe)))) == recipe


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ({"ring": {"rank": 10**6}}, "run.light.ring: light.ring.rank is 1000000"),
        ({"ring": {"position_nodes": 10**9}}, "ring.position_nodes is 1000000000"),
        ({"ring": {"rank": "16"}}, "run.light.ring: rank cannot be '16'"),
        ({"glow": 1}, "run.light: unknown setting 'glow'"),
        ([], "run.light: is not a group"),
    ],
)
def test_damaged_settings_are_named(light: object, said: str):
    with pytest.raises(RecipeError) as caught:
        recipe_from_dict(type(METHODS["ringlight"]), {"light": light}, "run")
    assert said in str(caught.value)
    assert ".;" not in str(caught.value)


@pytest.mark.parametrize(
    ("shading", "given", "settled"),
    [("deferred", None, True), ("forward", None, False), ("deferred", False, False), ("forward", True, True)],
)
def test_a_settled_recipe_says_whether_it_is_antialiased(shading: str, given: bool | None, settled: bool):
    recipe = replace(METHODS["ringlight"], shading=shading, antialiased=given)
    kept, _ = recipe.settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert kept.antialiased is settled


def test_deferred_shading_is_recorded_with_the_settings_that_count():
    recipe = replace(METHODS["ringlight"], shading="deferred", steps=70)
    kept, _ = recipe.settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert kept == recipe.mirror
    assert "levels" in recipe_to_dict(kept)["shader"]


def test_settings_that_deferred_shading_does_not_know_are_named():
    ours = METHODS["ringlight"]
    densify = replace(ours.densify, max_gaussians=500)
    silent = replace(ours, shading="deferred", steps=70, visible_only=True, densify=densify)
    loud = replace(silent, base_rate=1.0, densify=replace(densify, drop_share=0.1))
    rasterize = rasterizer_for("auto")
    assert silent.settled(tiny_scene(), rasterize, 0)[1] is None
    why = loud.settled(tiny_scene(), rasterize, 0)[1]
    assert why is not None
    assert why.startswith("what was given for base-rate, densify counts for forward shading alone")
    assert replace(loud, shading="forward").settled(tiny_scene(), rasterize, 0)[1] is None
