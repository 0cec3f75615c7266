"""The most Gaussians that a machine has memory for: stated, recorded, and left to who knows better."""

import dataclasses
import json
from pathlib import Path

import pytest
import torch
from cli_session import QUICK
from scenes_on_disk import write_tiny_scene

from ringlight.cli.main import run
from ringlight.core.scene import PointCloud
from ringlight.fit import room
from ringlight.fit.room import COPIES, WORK_BYTES
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.limits import bounded
from tiny_scene import tiny_scene


def built(max_gaussians: int = 0):
    recipe, scene = METHODS["3dgs"], tiny_scene(views=4, size=24)
    recipe = dataclasses.replace(recipe, densify=dataclasses.replace(recipe.densify, max_gaussians=max_gaussians))
    return recipe, scene, recipe.build(scene, rasterizer_for("auto"), seed=0)


def test_where_the_recipes_own_bound_fits_nothing_changes():
    recipe, scene, training = built()
    assert bounded(recipe, scene, training, 10_000) == (recipe, scene, ())


def test_a_bound_is_set_and_the_points_thinned_evenly():
    recipe, scene, training = built()
    changed, fewer, notes = bounded(recipe, scene, training, 100)
    assert changed.densify.max_gaussians == 100
    assert len(notes) == 2
    assert "--densify.max-gaussians" in notes[0]
    assert torch.equal(fewer.points.positions, scene.points.positions[torch.arange(100) * 4])
    assert torch.equal(fewer.points.colors, scene.points.colors[torch.arange(100) * 4])


@pytest.mark.parametrize(("steps", "kept"), [(4000, 40), (200, 100)])
def test_the_bound_counts_what_is_dropped_later(steps: int, kept: int):
    recipe, scene, _ = built()
    recipe = dataclasses.replace(recipe, steps=steps, densify=dataclasses.replace(recipe.densify, drop_share=0.6))
    training = recipe.build(scene, rasterizer_for("auto"), seed=0)
    changed, _, notes = bounded(recipe, scene, training, 100)
    assert changed.densify.max_gaussians == kept
    assert "at most 100 Gaussians" in notes[0]
    grown = changed.build(scene, rasterizer_for("auto"), seed=0).strategies
    assert [strategy.most for strategy in grown if strategy.most is not None] == [100]


def test_who_states_a_bound_knows_better():
    recipe, scene, training = built(max_gaussians=450)
    assert bounded(recipe, scene, training, 100) == (recipe, scene, ())
    many = dataclasses.replace(scene, points=PointCloud(torch.zeros(1000, 3), torch.zeros(1000, 3)))
    assert len(bounded(recipe, many, training, 100)[1].points.positions) == 450


def test_what_does_not_grow_is_left_alone():
    recipe, scene, training = built()
    fixed = dataclasses.replace(training, strategies=training.strategies[:1])
    assert bounded(recipe, scene, fixed, 100) == (recipe, scene, ())


def test_the_bound_is_said_recorded_and_kept_when_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scene = write_tiny_scene(tmp_path / "balls")
    monkeypatch.setattr(room, "machine_memory", lambda: 200 * 2 * (COPIES * 4 * 59 + WORK_BYTES))
    assert run(["train", str(scene), "3dgs", "--out", str(tmp_path / "run"), *QUICK]) == 0
    told = capsys.readouterr().err
    assert "at most 200 Gaussians instead of 400" in told
    assert "200 of the 300 points" in told
    record = json.loads((tmp_path / "run" / "recipe.json").read_text())
    assert record["recipe"]["densify"]["max_gaussians"] == 200
    assert json.loads((tmp_path / "run" / "report.json").read_text())["counted"] <= 200


def test_a_run_without_a_bound_ends_with_a_sentence_before_memory_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scene = write_tiny_scene(tmp_path / "balls")
    monkeypatch.setattr(room, "machine_memory", lambda: 320 * 2 * (COPIES * 4 * 59 + WORK_BYTES))
    growing = ("--densify.threshold", "0", "--densify.begin", "1", "--densify.every", "2", "--densify.stop", "1")
    unbounded = ("--densify.no-pixel-bound", *growing)
    assert run(["train", str(scene), "3dgs", "--out", str(tmp_path / "run"), *QUICK, *unbounded]) == 1
    told = capsys.readouterr().err
    assert "50% of this machine's memory holds 320; bound it with --densify.max-gaussians" in told
    assert "instead of" not in told, "nothing was bounded before"


def test_verify_keeps_within_the_same_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scene = write_tiny_scene(tmp_path / "balls")
    monkeypatch.setattr(room, "machine_memory", lambda: 200 * 2 * (COPIES * 4 * 59 + WORK_BYTES))
    assert run(["train", str(scene), "3dgs", *QUICK, "--verify", "4"]) == 0
    told = capsys.readouterr()
    assert "warning: at most 200 Gaussians instead of 400" in told.err
    assert told.out.count("the same bits") == 4
