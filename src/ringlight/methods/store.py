"""Models on disk: a model file is a recipe plus tensors."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

import ringlight
from ringlight.core.camera import Camera
from ringlight.core.finite import first_not_finite
from ringlight.core.scene import Scene
from ringlight.data.options import SceneOptions
from ringlight.errors import DivergedError, ModelFileError, RecipeError
from ringlight.files.model_file import ModelHeader, SceneFacts, read_model_file, write_model_file
from ringlight.files.packed import Packed, pack_exactly
from ringlight.methods.outline import refuse_misfits
from ringlight.methods.recipe import Recipe, recipe_to_dict
from ringlight.methods.table import METHODS, method_of, recipe_of_method
from ringlight.models.contract import Model
from ringlight.rasterize.contract import Rasterizer

CAMERAS_PREFIX = "cameras."
"""Tensors below this name hold the training cameras; rendering does not need them."""

LARGEST_SIDE = 1 << 20
"""Pixels of a camera in a model file; any more is a damaged number."""


@dataclass(frozen=True)
class StoredModel:
    """A model that renders, and everything its file says about it."""

    model: Model
    header: ModelHeader
    cameras: tuple[Camera, ...]
    """The training cameras: paths and exports start from them."""
    rasterize: Rasterizer
    """What the model was loaded for."""


def scene_facts(scene: Scene, options: SceneOptions | None = None) -> SceneFacts:
    """What a model file remembers of the scene, and by which ``options``, or the usual ones, to read it again."""
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
        options=asdict(options or SceneOptions()),
    )


def model_header(
    preset: str, recipe: Recipe, step: int, scene: SceneFacts, metrics: dict[str, object] | None = None
) -> ModelHeader:
    """The header of a model file; ``metrics`` are those of the test views, if measured."""
    return ModelHeader(
        method=method_of(recipe),
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


def save_model(path: str | Path, model: Model, header: ModelHeader, cameras: Sequence[Camera]) -> None:
    """Write the model and its training cameras as one safetensors file, all or nothing; packed as its method says,
    where that loses nothing.

    Raises OutputError, or DivergedError for a model that is not finite.
    """
    tensors = model.rendering_tensors() | tensors_from_cameras(cameras)
    broken = first_not_finite(tensors)
    if broken is not None:
        raise DivergedError(f"{path}: {broken}, and such a model is not saved; go back to a state from before")
    count, _ = model.rendering_size()
    plan = METHODS[header.method].packings
    content = pack_exactly(tensors, plan) if plan else Packed(tensors, {})
    write_model_file(Path(path), content, replace(header, counted=count.number, noun=count.noun))


def load_model(path: str | Path, rasterize: Rasterizer) -> StoredModel:
    """A model from its file, or from the run folder that holds it.

    Raises ModelFileError for a file that is cut, damaged, newer, of an unknown method, lacks a tensor, or holds a
    number that is not finite.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "model.safetensors"
    stored = read_model_file(path)
    return model_of_tensors(stored.tensors, stored.header, rasterize, path)


def model_of_tensors(
    tensors: Mapping[str, torch.Tensor], header: ModelHeader, rasterize: Rasterizer, path: Path
) -> StoredModel:
    """The model that a file's tensors and header describe; ``path`` is named where they do not fit each other."""
    broken = first_not_finite(tensors)
    if broken is not None:
        raise ModelFileError(f"{path}: {broken}; copy the file again, or train again")
    try:
        recipe = recipe_of_method(header.method, header.recipe, str(path))
    except KeyError:
        sentence = f"{path}: method {header.method!r} is unknown to this version of ringlight; update it"
        raise ModelFileError(sentence) from None
    try:
        box = torch.tensor(header.scene.box)
        of_model = {name: tensor for name, tensor in tensors.items() if not name.startswith(CAMERAS_PREFIX)}
        recipe = recipe.as_stored({name: tuple(tensor.shape) for name, tensor in of_model.items()})
        refuse_misfits(recipe, box, rasterize, of_model)
        cameras = cameras_from_tensors(tensors)
        model = recipe.model(box, rasterize)
        model.load_tensors(of_model)
    except (KeyError, RuntimeError, ValueError, RecipeError) as error:
        reason = (str(error).strip("'").splitlines() or [type(error).__name__])[-1].strip()
        raise ModelFileError(
            f"{path}: its tensors do not fit its recipe ({reason}); copy the file again, or train again"
        ) from None
    return StoredModel(model.eval(), header, cameras, rasterize)


def tensors_from_cameras(cameras: Sequence[Camera]) -> dict[str, torch.Tensor]:
    """World-to-camera matrices [M 4 4] and (focal x, y, centre x, y, width, height) [M 6], float32, in pixels."""
    pinholes = [[*camera.focal, *camera.center, camera.width, camera.height] for camera in cameras]
    matrices = [camera.world_to_camera for camera in cameras]
    return {
        f"{CAMERAS_PREFIX}world_to_camera": torch.stack(matrices) if matrices else torch.zeros(0, 4, 4),
        f"{CAMERAS_PREFIX}pinholes": torch.tensor(pinholes, dtype=torch.float32).reshape(-1, 6),
    }


def cameras_from_tensors(tensors: Mapping[str, torch.Tensor]) -> tuple[Camera, ...]:
    """Inverse of :func:`tensors_from_cameras`. Raises KeyError or ValueError for tensors that are not that."""
    matrices, pinholes = tensors[f"{CAMERAS_PREFIX}world_to_camera"], tensors[f"{CAMERAS_PREFIX}pinholes"]
    count = matrices.shape[:1]
    if matrices.shape != (*count, 4, 4) or pinholes.shape != (*count, 6):
        raise ValueError("the training cameras have another shape than [M 4 4] and [M 6]")
    sides = pinholes[:, 4:]
    if not bool(((sides >= 1) & (sides <= LARGEST_SIDE)).all()):
        raise ValueError(f"a training camera has a side of other than 1 to {LARGEST_SIDE} pixels")
    rows = zip(matrices.unbind(0), pinholes.tolist(), strict=True)
    return tuple(Camera(m.contiguous(), (p[0], p[1]), (p[2], p[3]), int(p[4]), int(p[5])) for m, p in rows)
