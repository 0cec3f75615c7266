"""Files of volumes that a hostile writer made, with a checksum that fits: one sentence, before anything is drawn."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from ringlight.errors import ModelFileError
from ringlight.files.model_file import read_model_file, write_model_file
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume.grids import MOST_NODES
from ringlight.volume.occupancy import MOST_CELLS
from small_recipes import small
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=3, size=12)


@pytest.fixture(scope="module", params=["tensorf", "putt"])
def file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volume") / "model.safetensors"
    recipe = small(request.param)
    model = recipe.build(SCENE, rasterizer_for("cpu"), 0).model
    header = model_header(request.param, recipe, 0, scene_facts(SCENE))
    save_model(path, model, header, [view.camera for view in SCENE.train])
    return path


def flipped(box: Tensor) -> Tensor:
    return box.flip(0).contiguous()


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("box", flipped, "'box' is a box without an inside"),
        ("occupied_box", flipped, "'occupied_box' is a box without an inside"),
        ("box", lambda box: box[:1].expand(2, 3).contiguous(), "'box' is a box without an inside"),
        ("box", lambda box: 3e38 * box.sign(), "'box' is a box of endless sides"),
        ("unit", lambda unit: 0 * unit, "'unit' is no length"),
        ("unit", lambda unit: -unit, "'unit' is no length"),
        ("occupied", lambda bits: bits.new_zeros(5000, 1, 1), f"5000 x 1 x 8 cells; {MOST_CELLS} are the most"),
        ("occupied", lambda bits: bits.new_zeros(1, 1, 21), "1 x 1 x 168 cells"),
        ("occupied", lambda bits: bits[0, 0, 0].clone(), "do not fit"),
        ("box", lambda box: box[0, 0].clone(), "do not fit"),
    ],
)
def test_what_cannot_be_is_refused(
    file: Path, tmp_path: Path, name: str, change: Callable[[Tensor], Tensor], words: str
):
    stored = read_model_file(file)
    spoiled = tmp_path / "model.safetensors"
    write_model_file(spoiled, stored.tensors | {name: change(stored.tensors[name])}, stored.header)
    assert load_model(file, rasterizer_for("cpu"))
    with pytest.raises(ModelFileError, match="do not fit") as caught:
        load_model(spoiled, rasterizer_for("cpu"))
    assert words in str(caught.value)


@pytest.mark.parametrize("nodes", [None, MOST_NODES + 1])
def test_lines_of_impossible_length_are_refused(file: Path, tmp_path: Path, nodes: int | None):
    stored = read_model_file(file)
    name = next((n for n in stored.tensors if n.startswith("field.density_") and n.endswith(".0")), "")
    lines = {n for n in stored.tensors if n.startswith("field.density_factors.lines.")} or {name}
    tensors = dict(stored.tensors)
    for line in lines:
        tensors[line] = torch.tensor(1.0) if nodes is None else torch.ones(nodes, *tensors[line].shape[1:])
    spoiled = tmp_path / "model.safetensors"
    write_model_file(spoiled, tensors, stored.header)
    with pytest.raises(ModelFileError, match="do not fit"):
        load_model(spoiled, rasterizer_for("cpu"))


@pytest.mark.parametrize("name", ["box", "occupied_box"])
def test_a_box_has_two_corners_of_three_numbers(file: Path, name: str):
    """Checkpoints are not held against an outline first."""
    model = load_model(file, rasterizer_for("cpu")).model
    tensors = dict(model.state_dict())
    with pytest.raises(ValueError, match=f"'{name}' has shape"):
        model.load_tensors(tensors | {name: tensors[name].repeat(1, 2)})
