"""Models on disk: a model file is a recipe plus tensors."""

import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

import ringlight
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import Scene
from ringlight.errors import ModelFileError
from ringlight.files.model_file import ModelHeader, SceneFacts, read_model_file, write_model_file
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.table import METHODS
from ringlight.models.splats import COLUMNS_PREFIX, SplatModel
from ringlight.rasterize.contract import Rasterizer


@dataclass(frozen=True)
class StoredModel:
    """A model that renders, and everything its file says about it."""

    model: SplatModel
    header: ModelHeader


def scene_facts(scene: Scene) -> SceneFacts:
    """What a model file remembers of the scene."""
    camera = scene.train[0].camera
    low, high = (tuple(corner) for corner in scene.box.tolist())
    return SceneFacts(
        name=scene.name,
        source=scene.source,
        background=scene.background,
        resolution=(camera.width, camera.height),
        box=(low, high),
        extent=scene.extent,
        notes=scene.notes,
    )


def model_header(
    preset: str, recipe: Any, step: int, scene: SceneFacts, metrics: dict[str, object] | None = None
) -> ModelHeader:
    """The header of a model file; ``metrics`` are those of the test views, if measured."""
    return ModelHeader(
        method=type(recipe).__name__,
        preset=preset,
        recipe=recipe_to_dict(recipe),
        step=step,
        scene=scene,
        metrics=metrics or {},
        versions={
            "ringlight": ringlight.__version__,
            "torch": torch.__version__,
            "python": platform.python_version(),
        },
    )


def for_rendering(model: SplatModel) -> dict[str, torch.Tensor]:
    """The tensors that rendering needs: no unwanted rows, no columns that only training looks at."""
    keep = model.color.wanted(model.gaussians)
    tensors = {}
    for name, tensor in model.state_dict().items():
        column = name.removeprefix(COLUMNS_PREFIX) if name.startswith(COLUMNS_PREFIX) else None
        if column in model.color.training_columns:
            continue
        tensors[name] = tensor if column is None else tensor[keep]
    return tensors


def save_model(path: Path, model: SplatModel, header: ModelHeader) -> None:
    """Write the model as one safetensors file, all or nothing. Raises ModelFileError."""
    write_model_file(path, for_rendering(model), header)


def load_model(path: Path, rasterize: Rasterizer) -> StoredModel:
    """A model from its file, or from the run folder that holds it.

    Raises ModelFileError for a file that is cut, damaged, newer, of an unknown method, or lacks a tensor.
    """
    if path.is_dir():
        path = path / "model.safetensors"
    stored = read_model_file(path)
    kinds = {type(recipe).__name__: type(recipe) for recipe in METHODS.values()}
    if stored.header.method not in kinds:
        raise ModelFileError(
            f"{path}: method {stored.header.method!r} is unknown to this version of ringlight; update it"
        )
    recipe = recipe_from_dict(kinds[stored.header.method], stored.header.recipe, str(path))
    columns = {
        name.removeprefix(COLUMNS_PREFIX): tensor
        for name, tensor in stored.tensors.items()
        if name.startswith(COLUMNS_PREFIX)
    }
    try:
        gaussians = Gaussians.from_columns(columns)
        model = recipe.model(gaussians, torch.tensor(stored.header.scene.box), rasterize)
        model.load_state_dict(stored.tensors)
    except (KeyError, RuntimeError) as error:
        reason = str(error).splitlines()[-1].strip()
        raise ModelFileError(f"{path}: its tensors do not fit its recipe ({reason}); copy the file again") from None
    return StoredModel(model.eval(), stored.header)
