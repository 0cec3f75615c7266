"""Every preset belongs to one method, which files and reports name, whatever was changed in it."""

import dataclasses

import pytest
import torch

from ringlight.data.synthetic import tiny_scene
from ringlight.errors import RecipeError
from ringlight.methods.store import model_header, scene_facts
from ringlight.methods.table import METHODS, method_named, method_of
from ringlight.rasterize.choose import rasterizer_for


def test_presets_of_one_paper_share_their_method():
    facts = scene_facts(tiny_scene(views=2, size=8))
    names = {preset: method_of(recipe) for preset, recipe in METHODS.items()}
    assert names == {
        "ringlight": "ringlight",
        "ringlight-mirror": "ringlight-mirror",
        "ringlight-paper": "ringlight",
        "3dgs": "3dgs",
    }
    assert method_of(dataclasses.replace(METHODS["ringlight-paper"], steps=5)) == "ringlight"
    assert model_header("ringlight-paper", METHODS["ringlight-paper"], 0, facts).method == "ringlight"


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(RecipeError, match="perhaps you meant 'ringlight'"):
        method_named("ringlite")


def test_what_is_asked_for_is_not_decided():
    asked = dataclasses.replace(METHODS["ringlight"], shading="forward", antialiased=False)
    for recipe in (asked, METHODS["ringlight-paper"], METHODS["3dgs"], METHODS["ringlight-mirror"]):
        assert recipe.settled(tiny_scene(), rasterizer_for("auto"), 0) == (recipe, None)


def test_older_files_that_say_deferred_have_no_factors_of_the_place():
    recipe = dataclasses.replace(METHODS["ringlight"], shading="deferred")
    scene = tiny_scene()
    table = recipe.build(scene, rasterizer_for("auto"), 3).model.gaussians
    model = recipe.model(table, scene.box, rasterizer_for("auto"))
    newer = recipe.mirror.model(table, scene.box, rasterizer_for("auto"))
    assert set(newer.state_dict()) - set(model.state_dict()) == {"shader.places.axes"}


def test_deferred_ringlight_is_the_mirror_with_the_settings_that_both_have():
    densify = dataclasses.replace(METHODS["ringlight"].densify, max_gaussians=900)
    recipe = dataclasses.replace(METHODS["ringlight"], steps=70, densify=densify, shading="deferred")
    mirror = METHODS["ringlight-mirror"]
    bounded = dataclasses.replace(mirror.densify, max_gaussians=900)
    assert recipe.mirror == dataclasses.replace(mirror, steps=70, densify=bounded)
    ours = recipe.build(tiny_scene(), rasterizer_for("auto"), 3).state()
    its = recipe.mirror.build(tiny_scene(), rasterizer_for("auto"), 3).state()
    assert ours.keys() == its.keys()
    assert all(torch.equal(ours[name], its[name]) for name in ours)


def test_short_runs_see_photographs_of_full_size_for_most_of_their_steps():
    scene = tiny_scene(views=2, size=256)
    for steps, whole in ((30_000, 1401), (7_000, 1401), (1_000, 201), (9, 1)):
        batches = dataclasses.replace(METHODS["3dgs"], steps=steps).build(scene, rasterizer_for("auto"), 0).batches
        assert batches.at(whole).camera.width == 256
        assert whole == 1 or batches.at(whole - 1).camera.width == 128
