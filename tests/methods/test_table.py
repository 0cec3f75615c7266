"""Every preset belongs to one method, which files and reports name, whatever was changed in it."""

import dataclasses

import pytest

from ringlight.data.synthetic import tiny_scene
from ringlight.errors import RecipeError
from ringlight.methods.store import model_header, scene_facts
from ringlight.methods.table import METHODS, method_named, method_of


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
