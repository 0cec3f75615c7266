"""Every preset belongs to one method, which files and reports name, whatever was changed in it."""

import dataclasses
import json
from typing import Any

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.methods.recipe import Recipe, recipe_to_dict
from ringlight.methods.store import model_header, scene_facts
from ringlight.methods.table import ABOUT, METHODS, method_named, method_of, recipe_of_method
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import SPLATS, TRAINED, small
from tiny_scene import tiny_scene


def test_presets_of_one_paper_share_their_method():
    facts = scene_facts(tiny_scene(views=2, size=8))
    names = {preset: method_of(recipe) for preset, recipe in METHODS.items()}
    assert names == {
        "ringlight": "ringlight",
        "ringlight-basis": "ringlight-basis",
        "ringlight-ring": "ringlight-ring",
        "ringlight-mirror": "ringlight-mirror",
        "ringlight-paper": "ringlight-ring",
        "3dgs": "3dgs",
        "3dgs-paper": "3dgs",
        "light-gaussian": "light-gaussian",
        "3dgs-dr": "3dgs-dr",
        "gaussian-shader": "gaussian-shader",
        "glossy-gaussian": "glossy-gaussian",
        "tensorf": "tensorf",
        "putt": "putt",
        "3igs": "3igs",
    }
    assert method_of(dataclasses.replace(METHODS["ringlight-paper"], steps=5)) == "ringlight-ring"
    assert model_header("ringlight-paper", METHODS["ringlight-paper"], 0, facts).method == "ringlight-ring"


def test_each_is_explained_in_a_line_of_the_help():
    assert ABOUT.keys() == METHODS.keys()
    assert all(about and len(about) <= 100 for about in ABOUT.values())


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(RecipeError, match="perhaps you meant 'ringlight'"):
        method_named("ringlite")


@pytest.mark.parametrize("method", TRAINED)
def test_what_is_asked_for_is_not_decided(method: str):
    """Only what was left open is, and once."""
    settled, why = METHODS[method].settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert settled.settled(tiny_scene(), rasterizer_for("auto"), 0) == (settled, None)
    assert (why is None) == (METHODS[method] == settled or method in SPLATS)
    asked, found = stated(METHODS[method]), stated(settled)
    assert {name: found[name] for name in asked} == asked


def stated(recipe: Recipe) -> dict[str, object]:
    """Settings that are not left open, by dotted name."""

    def of(values: dict[str, Any], where: str) -> dict[str, object]:
        found: dict[str, object] = {}
        for name, value in values.items():
            found |= of(value, f"{where}{name}.") if isinstance(value, dict) else {f"{where}{name}": value}
        return {name: value for name, value in found.items() if value is not None}

    return of(recipe_to_dict(recipe), "")


@pytest.mark.parametrize("method", TRAINED)
def test_a_file_has_a_recipe_of_its_method(method: str):
    recipe = METHODS[method]
    stored = json.loads(json.dumps(recipe_to_dict(recipe)))
    assert recipe_of_method(method_of(recipe), stored, "file") == recipe


@pytest.mark.parametrize("name", ["ringlight", "ringlight-paper", "4dgs"])
def test_no_file_is_of_a_chooser_or_an_unknown_method(name: str):
    with pytest.raises(KeyError):
        recipe_of_method(name, {}, "file")


@pytest.mark.parametrize("method", TRAINED)
def test_a_model_takes_the_tensors_of_a_trained_one(method: str):
    scene, rasterize = tiny_scene(views=4, size=16), rasterizer_for("auto")
    recipe = small(method)
    tensors = recipe.build(scene, rasterize, 3).model.rendering_tensors()
    shapes = {name: tuple(tensor.shape) for name, tensor in tensors.items()}
    model = recipe.as_stored(shapes).model(scene.box, rasterize)
    assert model.counted().number == 0 or not model.row_prefixes
    model.load_tensors(tensors)
    assert model.rendering_tensors().keys() == tensors.keys()
    assert all(torch.equal(tensor, tensors[name]) for name, tensor in model.state_dict().items())


def test_short_runs_see_photographs_of_full_size_for_most_of_their_steps():
    scene = tiny_scene(views=2, size=256)
    for steps, whole in ((30_000, 1401), (7_000, 1401), (1_000, 201), (9, 1)):
        batches = dataclasses.replace(METHODS["3dgs"], steps=steps).build(scene, rasterizer_for("auto"), 0).batches
        assert batches.at(whole).camera.width == 256
        assert whole == 1 or batches.at(whole - 1).camera.width == 128
