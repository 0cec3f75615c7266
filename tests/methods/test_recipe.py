"""Recipes survive JSON; what a file holds instead is refused with the place where it stands."""

import json
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest

from ringlight.core.later import came_later, value_before
from ringlight.errors import RecipeError
from ringlight.methods.recipe import Recipe, recipe_from_dict, recipe_to_dict
from ringlight.methods.table import CHOOSERS, METHODS
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import SPLATS
from tiny_scene import tiny_scene


@pytest.mark.parametrize("preset", METHODS)
def test_json_and_back(preset: str):
    recipe = METHODS[preset]
    assert recipe_from_dict(type(recipe), json.loads(json.dumps(recipe_to_dict(recipe)))) == recipe


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ({"ring": {"rank": 10**6}}, "run.light.ring: light.ring.rank is 1000000"),
        ({"ring": {"rank": None}}, "run.light.ring: setting 'rank' is missing"),
        ({"ring": {"position_nodes": 10**9}}, "ring.position_nodes is 1000000000"),
        ({"ring": {"rank": "16"}}, "run.light.ring: rank cannot be '16'"),
        ({"glow": 1}, "run.light: unknown setting 'glow'"),
        ([], "run.light: is not a group"),
    ],
)
def test_damaged_settings_are_named(light: object, said: str):
    recipe = METHODS["ringlight-ring"]
    with pytest.raises(RecipeError) as caught:
        recipe_from_dict(type(recipe), changed(recipe_to_dict(recipe), {"light": light}), "run")
    assert said in str(caught.value)
    assert ".;" not in str(caught.value)


@pytest.mark.parametrize("preset", METHODS)
def test_a_file_that_lacks_a_later_setting_means_what_there_was_before(preset: str):
    recipe = METHODS[preset]
    older, expected = without_later(recipe)
    assert recipe_from_dict(type(recipe), json.loads(json.dumps(older))) == expected


def test_a_model_whose_rates_fell_to_zero_is_still_read():
    """Nothing more is trained of them; models of before have them."""
    stored = recipe_to_dict(METHODS["ringlight-ring"])
    stored |= {"rates": stored["rates"] | {"means_end": 0.0, "scales_end": 0.0}, "field_rate_end": 0.0}
    recipe = recipe_from_dict(type(METHODS["ringlight-ring"]), stored)
    assert recipe.rates.scales_end == 0
    with pytest.raises(RecipeError, match=r"field_rate_end is 0, .* above 0"):
        recipe.build(tiny_scene(), rasterizer_for("auto"), 0)


def without_later(record: Any) -> tuple[dict[str, Any], Any]:
    """Settings as an older program wrote them, and the record with the later ones as they were before."""
    stored, before = {}, {}
    for field in fields(record):
        value = getattr(record, field.name)
        if is_dataclass(value):
            stored[field.name], before[field.name] = without_later(value)
        elif came_later(field):
            before[field.name] = value_before(field)
        else:
            stored[field.name] = value
    return stored, replace(record, **before)


def each_number(settings: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Where numbers that are no whole ones stand."""
    for name, value in settings.items():
        if isinstance(value, dict):
            yield from each_number(value)
        elif isinstance(value, float):
            yield settings, name


@pytest.mark.parametrize("preset", METHODS)
def test_no_setting_is_infinite_or_no_number(preset: str):
    recipe = METHODS[preset]
    stored = recipe_to_dict(recipe)
    for place, name in each_number(stored):
        before = place[name]
        for value in (math.inf, -math.inf, math.nan):
            place[name] = value
            with pytest.raises(RecipeError):
                recipe_from_dict(type(recipe), stored)
        place[name] = before


def changed(stored: dict, changes: dict) -> dict:
    """Settings as files hold them, with some changed, or removed where None."""
    for name, value in changes.items():
        stored[name] = changed(stored[name], value) if isinstance(value, dict) else value
    return {name: value for name, value in stored.items() if name not in changes or value is not None}


@pytest.mark.parametrize("preset", METHODS)
def test_every_preset_answers_what_a_recipe_is_asked(preset: str):
    recipe = METHODS[preset]
    assert isinstance(recipe, Recipe)
    assert recipe.most is None
    assert recipe.ending_with(70).most == (70 if preset in (*CHOOSERS, *SPLATS) else None)
    assert recipe.ending_with(70).ending_with(None) == recipe
    assert (recipe.never_above(7000).most or 7000) <= 7000
    assert replace(recipe, steps=5).steps == 5
