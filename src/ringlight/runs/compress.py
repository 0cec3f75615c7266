"""A trained model in a third of the bytes: packed, looked at, written as one model file."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

import ringlight
from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from ringlight.core.stages import counted
from ringlight.core.want import Want
from ringlight.errors import OutputError, RunError
from ringlight.files.atomic import refuse_existing
from ringlight.files.model_file import write_model_file
from ringlight.files.pack_axes import pack_with_axes
from ringlight.files.packed import pack_tensors, unpack_tensors
from ringlight.files.tensor_file import read_metadata
from ringlight.measure import metrics
from ringlight.methods.store import CAMERAS_PREFIX, StoredModel, model_of_tensors, tensors_from_cameras
from ringlight.models.contract import Model
from ringlight.runs.finish import Tell, psnr_of_views
from ringlight.runs.opened import Opened, scene_facts_of

SUFFIX = ".safetensors"

MOST_PICTURES = 5
"""Training cameras from which the packed model is held against the model: well under a second each."""


@dataclass(frozen=True)
class Losses:
    """What packing cost. The three last are None where no photographs were at hand.

    ``picture_psnr`` compares pictures of the packed model with pictures of the model, dB, mean over those that differ
    of ``pictures`` training cameras; ``psnr_before`` and ``psnr_after`` are of ``views`` test views, dB, mean over
    images.
    """

    bytes_before: int
    """Of the tensors that rendering needs, as they were: floats at 32 bit."""
    bytes_after: int
    """Of the same, packed."""
    pictures: int
    picture_psnr: float | None
    psnr_before: float | None = None
    psnr_after: float | None = None
    views: int | None = None


@dataclass(frozen=True)
class Compressed:
    """What was written."""

    file: str
    counted: int
    noun: str
    bytes_file_before: int
    bytes_file: int
    losses: Losses


def check_target(path: Path, overwrite: bool) -> None:
    """Raises OutputError for another suffix than a model file's, or a file that exists and may not be replaced."""
    if path.suffix.lower() != SUFFIX:
        raise OutputError(f"{path}: cannot be written: a model file is a safetensors file; end its name in {SUFFIX}")
    refuse_existing(path, overwrite)


@torch.no_grad()
def compress(opened: Opened, path: Path, scene: Scene | None, tell: Tell) -> Compressed:
    """Write the packed model; with a ``scene``, its test views say what packing costs, without one it has no measures.

    ``tell`` hears (pictures done, pictures in all). A scene without test views counts as none. Raises RunError for a
    packed model, or one that packing makes no smaller, OutputError where the file cannot be written.
    """
    stored, size_before = opened.stored, opened.file.stat().st_size  # before it is replaced, perhaps
    if stored.header.storage:
        raise RunError(f"{opened.file}: is packed already; keep it as it is, or name the model that it was made of")
    if read_metadata(opened.file).get("packing", "{}") != "{}":
        raise RunError(f"{opened.file}: was packed by its training; keep it as it is")
    if scene is not None and not scene.test:
        scene = None
    tensors = stored.model.rendering_tensors() | tensors_from_cameras(stored.cameras)
    splats = stored.model.splats()
    packed = pack_with_axes(tensors) if splats is not None and splats.color.axes_are_normals else pack_tensors(tensors)
    if _bytes(packed.tensors) >= _bytes(tensors):
        raise RunError(
            f"{opened.file}: nothing of a {stored.header.method} model can be packed; keep the file as it is"
        )
    after = model_of_tensors(unpack_tensors(packed), stored.header, stored.rasterize, path)
    decibels = _picture_loss(stored, after)
    picture_psnr = metrics.psnr_of_different(decibels) if decibels else None
    losses = Losses(_bytes(tensors), _bytes(packed.tensors), len(decibels), picture_psnr)
    measured: dict[str, object] = {}  # those of the model are not of what packing leaves of it
    if scene is not None:
        psnr_before, psnr_after = _test_loss(stored.model, after.model, scene, tell)
        losses = replace(losses, psnr_before=psnr_before, psnr_after=psnr_after, views=len(scene.test))
        measured = {"psnr": psnr_after}
    versions = stored.header.versions | {"ringlight": ringlight.__version__}
    facts = scene_facts_of(opened)
    header = replace(stored.header, scene=facts, metrics=measured, versions=versions, storage=asdict(losses))
    write_model_file(path, packed, header)
    return Compressed(str(path), *after.model.counted(), size_before, path.stat().st_size, losses)


def _bytes(tensors: dict[str, Tensor]) -> int:
    """Of everything but the cameras, as stored."""
    shown = (tensor for name, tensor in tensors.items() if not name.startswith(CAMERAS_PREFIX))
    return sum(tensor.numel() * tensor.element_size() for tensor in shown)


def _picture_loss(before: StoredModel, after: StoredModel) -> list[float]:
    """PSNR of the two models against each other, dB, over white, from a few training cameras."""
    count = min(len(before.cameras), MOST_PICTURES)
    cameras = [before.cameras[index * len(before.cameras) // count] for index in range(count)]
    looked = counted("comparing pictures", cameras)

    def picture(model: Model, camera: Camera) -> torch.Tensor:
        return model.render(camera, torch.ones(3), Want.PICTURE).color.clamp(0, 1)

    return [metrics.psnr(picture(after.model, camera), picture(before.model, camera)) for camera in looked]


def _test_loss(before: Model, after: Model, scene: Scene, tell: Tell) -> tuple[float, float]:
    """PSNR of both models on the test views, which are rendered twice."""
    views = len(scene.test)
    psnr_before = psnr_of_views(before, scene, lambda done, _: tell(done, 2 * views))
    return psnr_before, psnr_of_views(after, scene, lambda done, _: tell(views + done, 2 * views))
