"""Where ringlight lights pixels, its files say what was trained; those that said otherwise are read all the same."""

import dataclasses
import json
from pathlib import Path

import pytest
import torch
from command import Command
from scenes_on_disk import edit_json

from ringlight.files.tensor_file import read_tensors, write_tensors
from ringlight.methods.recipe import recipe_to_dict
from ringlight.methods.table import METHODS

STEPS = 40
OLD = dataclasses.replace(METHODS["ringlight"], shading="deferred", antialiased=True, steps=STEPS)


@pytest.fixture
def deferred(tiny: Path, tmp_path: Path, ringlight: Command) -> Path:
    run = tmp_path / "deferred"
    words = ("--steps", STEPS, "--shading", "deferred", "--initial-points", "300", "--quiet", "--lpips")
    words += ("--save-every", "0.001")
    assert ringlight("train", tiny, "ringlight", *words, "--out", run).code == 0
    return run


@pytest.fixture
def older(deferred: Path) -> Path:
    """The same run as earlier versions wrote it: the settings of forward shading, and no method in recipe.json."""
    edit_json(deferred / "recipe.json", lambda record: record.update(recipe=recipe_to_dict(OLD)))
    edit_json(deferred / "recipe.json", lambda record: record.pop("method"))
    file = read_tensors(deferred / "model.safetensors")
    changes = {"method": "ringlight", "recipe": json.dumps(recipe_to_dict(OLD))}
    write_tensors(deferred / "model.safetensors", file.tensors, file.metadata | changes)
    return deferred


@pytest.fixture
def oldest(older: Path) -> Path:
    """With the model file of the time when shading was recorded so: features had no factors of the place yet."""
    file = read_tensors(older / "model.safetensors")
    tensors = {name: tensor for name, tensor in file.tensors.items() if name != "shader.places.axes"}
    assert len(tensors) == len(file.tensors) - 1
    write_tensors(older / "model.safetensors", tensors, file.metadata)
    return older


def test_its_files_record_the_settings_that_count(deferred: Path, ringlight: Command) -> None:
    shown = ringlight("info", deferred).out
    assert "ringlight (ringlight-mirror)" in shown
    assert "shader: " in shown
    assert "levels=[8, 16, 32, 64]" in shown
    assert "field_rate" not in shown
    record = json.loads((deferred / "recipe.json").read_text())
    assert (record["preset"], record["method"]) == ("ringlight", "ringlight-mirror")
    assert (record["recipe"]["steps"], record["recipe"]["shader"]["levels"]) == (STEPS, [8, 16, 32, 64])
    report = json.loads((deferred / "report.json").read_text())
    assert (report["preset"], report["method"]) == ("ringlight", "ringlight-mirror")


@pytest.mark.parametrize("which", ["deferred", "older"])
def test_it_goes_on_with_the_same_bits(which: str, request: pytest.FixtureRequest, ringlight: Command) -> None:
    run = request.getfixturevalue(which)
    whole = read_tensors(run / "model.safetensors").tensors
    (run / "checkpoint.safetensors").unlink()  # the other one is of a step before
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    again = read_tensors(run / "model.safetensors").tensors
    assert whole.keys() == again.keys()
    assert all(torch.equal(tensor, again[name]) for name, tensor in whole.items())


@pytest.mark.parametrize("which", ["deferred", "oldest"])
def test_every_command_takes_it(which: str, request: pytest.FixtureRequest, tmp_path: Path, ringlight: Command) -> None:
    run = request.getfixturevalue(which)
    for words in (
        ("info", run),
        ("eval", run, "--lpips"),
        ("render", run, "--path", "orbit", "--frames", "1"),
        ("compress", run, tmp_path / "small.safetensors"),
        ("eval", tmp_path / "small.safetensors", "--lpips"),
        ("compare", run),
        ("train", "--resume", run, "--quiet"),
    ):
        done = ringlight(*words)
        assert done.code == 0, done.err
