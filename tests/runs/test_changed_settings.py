"""What a run was given is told by name, and nothing that it was not given."""

from dataclasses import replace
from pathlib import Path

import pytest

from ringlight.data.options import SceneOptions
from ringlight.measure.report import GivenSetting
from ringlight.methods.table import METHODS
from ringlight.runs.changed_settings import Setting, settings_by_name, settings_changed, written
from ringlight.runs.record import RunRecord
from ringlight.runs.starting_points import with_points_of

MIRROR = METHODS["ringlight-mirror"]
DEFAULTS = RunRecord("ringlight-mirror", MIRROR, Path("/a scene"), SceneOptions(), 3, "auto", "0.1.0")


@pytest.mark.parametrize(
    ("name", "value", "words", "text"),
    [
        ("sh_rate", 0.004, ("--sh-rate", "0.004"), "0.004"),
        ("shader.levels", (4, 16), ("--shader.levels", "4", "16"), "4 16"),
        ("visible_only", True, ("--visible-only",), "on"),
        ("light.clamp_colors", False, ("--light.no-clamp-colors",), "off"),
        ("size", 7.0, ("--size", "7.0"), "7"),
        ("size", 7, ("--size", "7"), "7"),
        ("rates.hold", None, (), "left open"),
        ("bounds", (-0.66846197, 1.0), ("--bounds", "-0.66846197", "1.0"), "-0.66846 1"),
        ("start", "a b", ("--start", "a b"), "a b"),
    ],
)
def test_a_setting_in_words_of_the_command_line_and_of_the_page(
    name: str, value: object, words: tuple[str, ...], text: str
) -> None:
    assert Setting(name, value, "another").words == words
    assert written(value) == text


def test_nothing_differs_from_itself() -> None:
    assert settings_changed(DEFAULTS) == []
    assert settings_by_name(DEFAULTS) == {}


def test_a_report_is_told_of_the_recipe_and_of_how_the_scene_was_read() -> None:
    recipe = replace(MIRROR, undo_collapse=False, shader=replace(MIRROR.shader, levels=(4, 16)))
    made = replace(DEFAULTS, recipe=recipe, options=SceneOptions(downscale=2, validate=True))
    assert settings_by_name(made) == {
        "shader.levels": GivenSetting("4 16", "left open"),
        "undo_collapse": GivenSetting("off", "on"),
        "downscale": GivenSetting("2", "left open"),
        "validate": GivenSetting("on", "off"),
    }


def test_what_a_chooser_settled_on_is_held_against_that_method() -> None:
    assert settings_by_name(replace(DEFAULTS, preset="ringlight")) == {}


def test_added_steps_and_the_start_are_told_too() -> None:
    made = replace(DEFAULTS, added=(20, 5), start="/home/me/runs/first/model.safetensors")
    assert settings_by_name(made) == {"added": GivenSetting("20 5"), "from": GivenSetting("first")}
    assert settings_by_name(replace(DEFAULTS, start="/home/me/bought.ply")) == {"from": GivenSetting("bought.ply")}


@pytest.mark.parametrize("preset", METHODS)
def test_no_default_of_a_method_is_told(preset: str) -> None:
    recipe = METHODS[preset]
    options = with_points_of(recipe, SceneOptions(photo_memory=0.5))
    assert settings_by_name(replace(DEFAULTS, preset=preset, recipe=recipe, options=options)) == {}
