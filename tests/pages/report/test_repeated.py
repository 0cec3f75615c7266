"""The printed command is parsed by the real command line, and gives the same recipe."""

import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from ringlight.cli.parse import parse
from ringlight.cli.train import TrainArguments
from ringlight.data.bundled import bundled_scene
from ringlight.data.options import SceneOptions
from ringlight.methods.relight_recipe import relight_recipe
from ringlight.methods.table import METHODS
from ringlight.pages.report.repeated import commands
from ringlight.runs.changed_settings import options_changed
from ringlight.runs.record import RunRecord

RECIPES = {
    "3dgs": replace(METHODS["3dgs"], steps=700, antialiased=True, sh_rate=0.004).at_length(),
    "3dgs-paper": replace(METHODS["3dgs-paper"], steps=500),
    "ringlight-basis": replace(METHODS["ringlight-basis"], steps=3000).at_length(),
    "ringlight-mirror": replace(
        METHODS["ringlight-mirror"],
        visible_only=True,
        undo_collapse=False,
        shader=replace(METHODS["ringlight-mirror"].shader, levels=(4, 16), parallax=False),
    ),
    "ringlight-paper": replace(METHODS["ringlight-paper"], steps=1234),
}


def record(preset: str, **changes) -> RunRecord:
    recipe = RECIPES.get(preset) or RECIPES["ringlight-mirror"]
    whole = RunRecord(preset, recipe, Path("/a folder/'s scene"), SceneOptions(), 3, "auto", "0.1.0")
    return replace(whole, **changes)


def parsed(line: str) -> TrainArguments:
    program, verb, *words = shlex.split(line)
    assert (program, verb) == ("ringlight", "train")
    return parse(TrainArguments, "train", words, in_pairs=True)


@pytest.mark.parametrize("preset", [*RECIPES, "ringlight"])
def test_the_command_gives_the_same_recipe(preset: str) -> None:
    made = record(preset)
    [line] = commands(made)
    asked = parsed(line)
    assert asked.method == made.recipe
    assert (asked.scene, asked.seed, asked.options) == (made.scene, 3, made.options)


def test_how_the_scene_was_read_is_said_too() -> None:
    options = SceneOptions(background="black", downscale=2, invert_masks=True, holdout_every=4, masks="my masks")
    made = record("3dgs", options=options, device="cpu", start="/m.ply", added=(300, 20))
    first, *more = commands(made)
    asked = parsed(first)
    assert asked.options == options
    assert (asked.device, asked.from_) == ("cpu", Path("/m.ply"))
    assert more == [f"ringlight train --resume AGAIN --steps {steps}" for steps in (300, 20)]
    assert {one.name for one in options_changed(made)} == {
        "background",
        "downscale",
        "masks",
        "invert_masks",
        "holdout_every",
    }


def test_a_bundled_scene_is_called_by_its_name() -> None:
    assert commands(record("3dgs", scene=bundled_scene("toaster")))[0].startswith("ringlight train toaster 3dgs ")


def test_a_relit_run_is_relit_again() -> None:
    frozen = relight_recipe(RECIPES["ringlight-basis"], 300)
    line, more = commands(record("ringlight-basis", recipe=frozen, start="/m", device="cpu", added=(20,)))
    assert more == "ringlight train --resume AGAIN --steps 20"
    assert shlex.split(line) == [
        *("ringlight", "relight", "/m", "/a folder/'s scene", "AGAIN", "--steps", "300", "--seed", "3"),
        *("--device", "cpu"),
    ]
