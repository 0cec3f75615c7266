"""A volume's file whose tensors do not fit each other."""

from pathlib import Path

import pytest
import torch

from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.errors import ModelFileError
from ringlight.files.model_file import read_model_file, write_model_file
from ringlight.fit.train import Training
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small


def assert_refused_without_its_end(method: str, training: Training, scene: Scene, name: str, path: Path) -> None:
    """Saved whole it shows the same; where the last axis of this tensor lacks its end, bits of cells all, the file is
    refused."""
    header, cameras = model_header(method, small(method), 0, scene_facts(scene)), [view.camera for view in scene.train]
    save_model(path, training.model, header, cameras)
    stored = read_model_file(path)
    whole = load_model(path, rasterizer_for("cpu")).model
    camera = scene.test[0].camera
    ours = training.model.render(camera, scene.background_color, Want.EXACT).color
    assert torch.equal(whole.render(camera, scene.background_color, Want.EXACT).color, ours)
    spoiled = stored.tensors[name][..., : 0 if name == "occupied" else -1].contiguous()
    write_model_file(path, stored.tensors | {name: spoiled}, stored.header)
    with pytest.raises(ModelFileError, match="do not fit"):
        load_model(path, rasterizer_for("cpu"))
