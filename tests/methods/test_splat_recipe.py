"""What memory, studies and benchmarks ask of a recipe without knowing what it is, and what photographs decide."""

import dataclasses
from typing import Any

import pytest

from ringlight.data.dropout import Dropout
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.splat_recipe import FEW_PHOTOGRAPHS_DROPOUT, FEWEST_WITHOUT_DROPOUT
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

RECIPE = ThreeDGSRecipe(steps=4000)


def test_a_bound_is_stated_or_left_to_the_scene():
    assert RECIPE.most is None
    assert RECIPE.ending_with(70).most == 70
    assert RECIPE.ending_with(70).ending_with(None) == RECIPE


def recorded_with(recipe: ThreeDGSRecipe, **mcmc: object) -> ThreeDGSRecipe:
    """As a run keeps it, with these settings of mcmc in place of its own."""
    settled = recipe.at_length()
    changed = dataclasses.replace(settled.densify.mcmc, **mcmc)
    return dataclasses.replace(settled, densify=dataclasses.replace(settled.densify, mcmc=changed))


def test_what_decides_nothing_makes_no_other_run():
    """Records keep the settings of mcmc of the version that wrote them."""
    adaptive = ThreeDGSRecipe()
    assert adaptive.may_settle_on(recorded_with(adaptive, first_share=0.5, draw="opacity"))
    moving = dataclasses.replace(adaptive, densify=dataclasses.replace(adaptive.densify, kind="mcmc"))
    assert moving.may_settle_on(recorded_with(moving))
    cloned = dataclasses.replace(moving, densify=dataclasses.replace(moving.densify, clone_below=0.01))
    assert moving.may_settle_on(cloned.at_length())
    unreset = dataclasses.replace(adaptive, densify=dataclasses.replace(adaptive.densify, reset_every=0))
    wide = dataclasses.replace(unreset, densify=dataclasses.replace(unreset.densify, reset_opacity=0.3))
    assert unreset.may_settle_on(wide.at_length())
    assert not adaptive.may_settle_on(unreset.at_length())
    cloned = dataclasses.replace(adaptive, densify=dataclasses.replace(adaptive.densify, clone_below=0.3))
    assert not adaptive.may_settle_on(cloned.at_length())
    assert not moving.may_settle_on(recorded_with(moving, draw="opacity"))


def test_what_is_not_dropped_is_not_grown_either():
    dropping = dataclasses.replace(RECIPE, densify=dataclasses.replace(RECIPE.densify, drop_share=0.6))
    assert dropping.ending_with(70).densify.most_growing(4000) == 175
    assert dropping.ending_with(70, dropping=False).densify.most_growing(4000) == 70


@pytest.mark.parametrize("most", [1, 7, 100, 12_345, 1_000_003])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6, 0.9])
def test_no_more_than_that_at_any_step(most: int, share: float):
    dropping = dataclasses.replace(RECIPE, densify=dataclasses.replace(RECIPE.densify, drop_share=share))
    growing = dropping.never_above(most).densify.most_growing(4000)
    assert growing <= max(most, int(1 / (1 - share)))
    assert growing > most - 1 / (1 - share) - 1, "and not much less"


def test_few_photographs_are_trained_with_dropout():
    """And a run that left it to the photographs knows either as its own."""
    scene, rasterize = tiny_scene(views=12, size=16), rasterizer_for("auto")
    many = dataclasses.replace(scene, train=(scene.train * FEWEST_WITHOUT_DROPOUT)[:FEWEST_WITHOUT_DROPOUT])
    free, plain = RingLightBasisRecipe(steps=20), ThreeDGSRecipe(steps=20)
    fewer = dataclasses.replace(many, train=many.train[1:])
    for of, expected in ((scene, FEW_PHOTOGRAPHS_DROPOUT), (fewer, FEW_PHOTOGRAPHS_DROPOUT), (many, 0.0)):
        settled, _ = free.settled(of, rasterize, 0)
        assert settled.dropout == expected
        assert free.may_settle_on(settled)
        assert not dataclasses.replace(free, dropout=0.3).may_settle_on(settled)
        dropout = free.build(of, rasterize, 0).batches.dropout
        assert dropout == (Dropout(expected, after=10) if expected else None)
        assert plain.settled(of, rasterize, 0)[0].dropout == 0, "the paper's"
    asked = dataclasses.replace(free, dropout=0.3).settled(scene, rasterize, 0)[0]
    assert asked.dropout == 0.3
    assert not free.may_settle_on(asked), "no number of photographs decides on that"
    assert not free.may_settle_on(plain)


@pytest.mark.parametrize(("settings", "last"), [({}, 1500), ({"stop": 0.8}, 2400), ({"kind": "mcmc"}, 2500)])
def test_no_picture_has_holes_while_density_control_looks_at_it(settings: dict[str, Any], last: int):
    recipe = ThreeDGSRecipe(steps=3000, dropout=0.1, densify=DensifySettings(**settings))
    assert recipe.last_whole_step == last
    assert recipe.build(tiny_scene(views=2, size=8), rasterizer_for("auto"), 0).batches.dropout == Dropout(0.1, last)
