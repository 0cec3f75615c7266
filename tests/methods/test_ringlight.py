"""ringlight chooses a method: its recipe, the settings that all have, and the reason."""

import dataclasses

import pytest

from ringlight.errors import RecipeError
from ringlight.methods import reflection_trial
from ringlight.methods.recipe import Recipe
from ringlight.methods.ringlight import SUITS, GrowthBound, RingLightRecipe
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.splat_recipe import FEW_PHOTOGRAPHS_DROPOUT
from ringlight.methods.table import METHODS, method_of
from ringlight.rasterize.choose import rasterizer_for
from ringlight.shade.reflection_settings import FINE_LEVELS, USUAL_LEVELS
from tiny_scene import tiny_scene

RINGLIGHT = RingLightRecipe()
METHOD_OF_SHADING = {"basis": "ringlight-basis", "mirror": "ringlight-mirror", "harmonics": "3dgs"}


def settled(recipe: Recipe, size: int = 24):
    return recipe.settled(tiny_scene(size=size), rasterizer_for("auto"), 0)


def with_maps(recipe: Recipe, levels: tuple[int, ...] = USUAL_LEVELS) -> Recipe:
    """At its length; a mirror with these maps, a basis from balls with dropout, since photographs are few."""
    at_length = recipe.at_length()
    if isinstance(at_length, RingLightBasisRecipe):
        start = dataclasses.replace(at_length.start, form="balls")
        return dataclasses.replace(at_length, start=start, dropout=FEW_PHOTOGRAPHS_DROPOUT)
    if not isinstance(at_length, RingLightMirrorRecipe):
        return at_length
    return dataclasses.replace(at_length, shader=at_length.shader.for_levels(levels))


@pytest.mark.parametrize(("shading", "method"), METHOD_OF_SHADING.items())
def test_who_asks_for_a_shading_gets_its_method_without_a_reason(shading: str, method: str):
    assert settled(dataclasses.replace(RINGLIGHT, shading=shading)) == (with_maps(METHODS[method]), None)


def test_a_mirror_that_it_chooses_has_maps_as_fine_as_suit_the_photographs(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(reflection_trial, "chosen_shading", lambda *_: ("mirror", "told so"))
    expected = with_maps(METHODS["ringlight-mirror"], FINE_LEVELS)
    for recipe in (RINGLIGHT, RingLightRecipe(shading="mirror")):
        assert settled(recipe, size=320)[0] == expected


@pytest.mark.parametrize(("shading", "method"), METHOD_OF_SHADING.items())
def test_where_it_is_open_the_trial_decides_and_gives_the_reason(
    shading: str, method: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(reflection_trial, "chosen_shading", lambda *_: (shading, "told so"))
    recipe, why = settled(RINGLIGHT)
    assert method_of(recipe) == method
    assert why == f"method: {method}, {SUITS[shading]} (told so)"
    assert settled(recipe) == (recipe, None)


@pytest.mark.parametrize(("shading", "method"), METHOD_OF_SHADING.items())
def test_its_settings_are_those_of_the_chosen_method(shading: str, method: str):
    recipe = RingLightRecipe(70, shading, visible_only=True, densify=GrowthBound(900))
    expected = dataclasses.replace(METHODS[method], steps=70, visible_only=True).ending_with(900)
    assert settled(recipe)[0] == with_maps(expected)


def test_it_may_settle_on_what_it_may_choose():
    for shading, method in METHOD_OF_SHADING.items():
        recipe = METHODS[method].at_length()
        assert RINGLIGHT.may_settle_on(recipe)
        assert RINGLIGHT.may_settle_on(recipe.ending_with(900))
        told = [RingLightRecipe(shading=other).may_settle_on(recipe) for other in METHOD_OF_SHADING]
        assert told == [other == shading for other in METHOD_OF_SHADING]
        assert not RingLightRecipe(steps=70).may_settle_on(recipe)


@pytest.mark.parametrize("given", [None, True, False])
def test_pixels_are_antialiased_unless_that_was_said(given: bool | None):
    for shading in METHOD_OF_SHADING:
        recipe, _ = settled(RingLightRecipe(shading=shading, antialiased=given))
        assert recipe.antialiased is (shading == "mirror" if given is None else given)


def test_there_is_no_model_of_a_choice():
    with pytest.raises(RecipeError, match="chooses a method"):
        RINGLIGHT.model(tiny_scene().box, rasterizer_for("auto"))


def test_a_bound_below_nothing_is_refused():
    with pytest.raises(RecipeError, match=r"densify\.max_gaussians is -1"):
        GrowthBound(-1)
