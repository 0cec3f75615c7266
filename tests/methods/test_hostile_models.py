"""Model files that ask for more than they hold, and checkpoints that do not fit: refused before memory is asked for."""

import dataclasses
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from ringlight.errors import ModelFileError, RecipeError
from ringlight.files.tensor_file import read_tensors, write_tensors
from ringlight.fit.train import Training, train
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.checkpoints import refuse_misfits
from small_recipes import COARSE, TRAINED, with_settings
from tiny_scene import tiny_scene

SETTINGS = [
    ("ringlight-ring", ("light", "render_hidden"), 1024),
    ("ringlight-ring", ("light", "render_hidden"), 10**9),
    ("ringlight-ring", ("light", "modulation_hidden"), 10**30),
    ("ringlight-ring", ("light", "ring", "rank"), 128),
    ("ringlight-ring", ("light", "ring", "position_nodes"), 65_536 * 100),
    ("ringlight-ring", ("light", "ring", "features"), 1023),
    ("ringlight-ring", ("light", "latents"), 16),
    ("3dgs", ("sh_degree",), 10**9),
    ("3dgs", ("steps",), -1.5),
    ("ringlight-mirror", ("shader", "levels"), [1024] * 500),
    ("ringlight-mirror", ("shader", "hidden"), 10**6),
]


def training_of(method: str) -> Training:
    scene = tiny_scene(views=4, size=16)
    return with_settings(METHODS[method], COARSE | {"steps": 8}).build(scene, rasterizer_for("auto"), seed=0)


def write(path: Path, method: str) -> None:
    training = training_of(method)
    scene = training.batches.scene
    header = model_header(method, METHODS[method], 0, scene_facts(scene))
    save_model(path, training.model, header, [view.camera for view in scene.train])


def rewrite(path: Path, change: Callable[[dict, dict], object]) -> None:
    """``change`` gets tensors and metadata; the checksum is made anew, as a hostile writer would."""
    file = read_tensors(path)
    tensors, metadata = dict(file.tensors), dict(file.metadata)
    change(tensors, metadata)
    write_tensors(path, tensors, metadata)


def asking(keys: tuple, value: object) -> Callable[[dict, dict], None]:
    def ask(tensors: dict, metadata: dict) -> None:
        recipe = settings = json.loads(metadata["recipe"])
        for key in keys[:-1]:
            settings = settings[key]
        assert keys[-1] in settings
        settings[keys[-1]] = value
        metadata["recipe"] = json.dumps(recipe)

    return ask


OPENED = """
import resource, sys
from ringlight.errors import RinglightError
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
rasterize, before = rasterizer_for("auto"), None
for path in sys.argv[1:]:
    try:
        load_model(path, rasterize)
        print("loaded", 0)
    except RinglightError as error:
        print(type(error).__name__, peak() - (before or peak()))
    before = before or peak()
"""


def test_a_recipe_that_asks_for_memory_gets_none(tmp_path: Path) -> None:
    """In a process of its own, whose peak tells."""
    paths = []
    for number, (method, keys, value) in enumerate(SETTINGS):
        paths.append(tmp_path / str(number))
        write(paths[-1], method)
        rewrite(paths[-1], asking(keys, value))
    command = [sys.executable, "-c", OPENED, *map(str, paths)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=100)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert len(lines) == len(SETTINGS)
    assert {what for what, _ in lines} <= {"ModelFileError", "RecipeError"}
    assert max(float(megabytes) for _, megabytes in lines) < 50


@pytest.mark.parametrize(
    ("name", "spoiled"),
    [
        ("columns.means", torch.zeros(400, 2)),
        ("columns.means", torch.zeros(400, 3, dtype=torch.float64)),
        ("columns.means", torch.tensor(3.0)),
        ("columns.quats", torch.zeros(399, 4)),
        ("columns.sh_rest", torch.zeros(400, 15, 4)),
        ("columns.odd", torch.zeros(400)),
        ("color.active_degree", torch.zeros(3)),
        ("color.active_degree", torch.tensor(9)),
        ("color.active_degree", torch.tensor(-1)),
        ("cameras.pinholes", torch.zeros(4, 6)),
        ("cameras.pinholes", torch.full((4, 6), 3e38)),
        ("cameras.world_to_camera", torch.zeros(4, 4)),
    ],
)
def test_tensors_of_another_shape_are_refused(name: str, spoiled: torch.Tensor, tmp_path: Path) -> None:
    write(tmp_path / "model", "3dgs")
    rewrite(tmp_path / "model", lambda tensors, metadata: tensors.update({name: spoiled}))
    with pytest.raises(ModelFileError, match="do not fit") as caught:
        load_model(tmp_path / "model", rasterizer_for("auto"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", TRAINED)
def test_a_state_of_any_size_fits_its_recipe_and_no_other_does(method: str) -> None:
    trained, fresh = training_of(method), training_of(method)
    for _ in train(trained):
        pass
    if trained.model.splats() is not None:
        trained.optimizer.edit_rows(torch.arange(7))
    state = trained.state()
    refuse_misfits(state, fresh)
    for name in state:
        with pytest.raises(KeyError):
            refuse_misfits({key: value for key, value in state.items() if key != name}, fresh)
        if name.startswith("strategy."):
            continue
        for spoiled in (state[name][None], state[name].to(torch.float16), torch.tensor(3.0)):
            if spoiled.shape == state[name].shape and spoiled.dtype == state[name].dtype:
                continue
            with pytest.raises(ValueError, match=r"is torch\..* of shape"):
                refuse_misfits(state | {name: spoiled}, fresh)


@pytest.mark.parametrize(("name", "number"), [("step", -5), ("step", 2**62), ("faults", -1), ("optimizer.updates", -1)])
def test_a_state_that_counts_what_cannot_be_is_refused(name: str, number: int) -> None:
    training = training_of("3dgs")
    state = training.state()
    with pytest.raises(ValueError, match=f"{name} counts"):
        refuse_misfits(state | {name: torch.full_like(state[name], number)}, training)


def test_a_state_with_views_of_other_rows_than_gradients_is_refused() -> None:
    training = training_of("3dgs")
    with pytest.raises(ValueError, match="views for 7"):
        training.restore(training.state() | {"strategy.1.views": torch.zeros(7)})


def test_tables_that_no_tensor_shows_are_bounded() -> None:
    light = METHODS["ringlight-ring"].light
    with pytest.raises(RecipeError, match="gigabyte"):
        dataclasses.replace(light.ring, rank=64, position_nodes=65_536)
