"""Files, reports and commands take a model that is no table of Gaussians."""

from pathlib import Path

import pytest
import torch

from ringlight.cli.main import run
from ringlight.errors import ModelFileError
from ringlight.files.model_file import read_model_file, write_model_file
from ringlight.methods.recipe import Recipe
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.models.contract import Model
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.facts import facts_of
from ringlight.runs.finish import measure
from ringlight.runs.training_facts import TrainingFacts
from tiny_scene import tiny_scene
from voxel_grid import VoxelGrid, VoxelRecipe

SCENE = tiny_scene(views=6, size=16)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(METHODS, "voxels", VoxelRecipe())
    grid = VoxelGrid(4)
    torch.nn.init.uniform_(grid.colors)
    header = model_header("voxels", METHODS["voxels"], 7, scene_facts(SCENE))
    save_model(tmp_path / "grid.safetensors", grid, header, [view.camera for view in SCENE.train])
    return tmp_path / "grid.safetensors"


def test_it_is_a_model_and_its_recipe_a_recipe():
    assert isinstance(VoxelGrid(2), Model)
    assert isinstance(VoxelRecipe(), Recipe)


def test_its_file_opens_and_says_what_it_is_made_of(file: Path):
    stored = load_model(file, rasterizer_for("cpu"))
    assert str(stored.model.counted()) == "64 voxels"
    assert torch.equal(stored.model.state_dict()["colors"], read_model_file(file).tensors["colors"])
    assert (facts_of(file).header.counted, facts_of(file).header.noun) == (64, "voxels")


def test_its_tensors_must_fit_its_recipe(file: Path):
    stored = read_model_file(file)
    write_model_file(file, stored.tensors | {"colors": torch.zeros(5, 4, 4, 3)}, stored.header)
    with pytest.raises(ModelFileError, match=r"tensor 'colors' is torch\.float32 of shape"):
        load_model(file, rasterizer_for("cpu"))


def test_its_report_counts_its_voxels():
    report = measure(VoxelGrid(4), SCENE, TrainingFacts("voxels", "voxels"), nets=())
    assert (report.counted, report.noun, report.bytes_raw) == (64, "voxels", 64 * 12 + 1)


def test_commands_tell_of_it_or_refuse_it_in_a_sentence(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["info", str(file)]) == 0
    assert "64 voxels" in capsys.readouterr().out
    assert run(["compress", str(file), str(tmp_path / "small.safetensors"), "--json", "--quiet"]) == 1
    assert "nothing of a voxels model can be packed" in capsys.readouterr().err
    assert not (tmp_path / "small.safetensors").exists()
    assert run(["export", str(file), str(tmp_path / "grid.ply")]) == 1
    assert "this model is made of voxels" in capsys.readouterr().err
    assert not (tmp_path / "grid.ply").exists()
