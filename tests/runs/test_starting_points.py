"""Random points of a run: the user's number, else the method's, else by the photographs' size; recorded and kept."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from cli_session import QUICK, SMALL_LIGHT
from scenes_on_disk import write_tiny_scene

from ringlight.cli.main import run
from ringlight.data.options import SceneOptions
from ringlight.methods.table import METHODS
from ringlight.runs.starting_points import with_points_of


def test_ringlight_paper_starts_from_as_many_as_3dgs_whatever_the_photographs():
    assert with_points_of(METHODS["ringlight-paper"], SceneOptions()).initial_points == 100_000
    assert with_points_of(METHODS["ringlight-paper"], SceneOptions(initial_points=7)).initial_points == 7


@pytest.mark.parametrize("method", [name for name in METHODS if name != "ringlight-paper"])
def test_the_others_leave_it_to_the_photographs(method: str):
    assert with_points_of(METHODS[method], SceneOptions()) == SceneOptions()


def test_what_was_asked_besides_is_kept():
    asked = SceneOptions(downscale=2, validate=True)
    assert with_points_of(METHODS["ringlight-paper"], asked) == replace(asked, initial_points=100_000)


def test_a_run_records_its_number(tmp_path: Path):
    scene = write_tiny_scene(tmp_path / "balls")
    own = [word for word in QUICK if word not in ("--initial-points", "300")]
    asked = [*own, *SMALL_LIGHT, "--random-points", "450"]
    assert run(["train", str(scene), "ringlight-ring", "--out", str(tmp_path / "run"), *asked]) == 0
    record = json.loads((tmp_path / "run" / "recipe.json").read_text())
    assert record["options"]["initial_points"] == 450
    assert record["recipe"]["random_points"] == 450
