"""A run that learns other light for a model: an ordinary training in which all is frozen that light does not change."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from ringlight.color.shared_basis import BASIS, DC, SharedBasis
from ringlight.core.command_line import command
from ringlight.core.gradients import COLOR
from ringlight.core.scene import Scene
from ringlight.core.stages import counted
from ringlight.core.want import Want
from ringlight.errors import ModelFileError, RecipeError, RunError
from ringlight.measure import metrics
from ringlight.measure.nearness import distances
from ringlight.methods.light_edit import refuse_unlit
from ringlight.methods.relight_recipe import relight_recipe
from ringlight.methods.store import StoredModel, load_model
from ringlight.methods.table import recipe_of_method
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import host_rasterizer
from ringlight.runs.folder import RunFolder, refuse_taken
from ringlight.runs.light_pack import PACK_NAME, least_squares, pack_between, relit, transformed, write_pack
from ringlight.runs.limits import PreparedRun
from ringlight.runs.opened import Opened, open_model, recorded_scene
from ringlight.runs.record import RunRecord
from ringlight.runs.session import Session
from ringlight.runs.start import Loaded, start_run

Item = TypeVar("Item")

SAME_PLACE = 1e-4
"""Share of the scene's extent that a camera may be off and still be the same."""

COLOR_VIEWS = 10
"""Photographs by which shared colours are fitted before the first step, evenly spread."""

MOST_PICTURES = 5
"""Training cameras from which the pack's model is held against the run's."""


@dataclass(frozen=True)
class PackReport:
    """A pack that was written; ``picture_psnr`` compares the model under the pack with the run's own model, dB, mean
    over those that differ of ``pictures`` training cameras, and is None without cameras."""

    file: str
    bytes_file: int
    tensors: int
    pictures: int
    picture_psnr: float | None


def start_relighting(
    opened: Opened, photographs: Path, out: Path, steps: int, seed: int, device: str, loaded: Loaded
) -> Session:
    """A new run in ``out`` that learns the light of ``photographs``, which are read as the model's own were.

    Raises RecipeError for a method without light of its own that is shared, RunError for photographs from other
    cameras or of another size, else as start_run.
    """
    refuse_taken(out, relights=True)
    stored = opened.stored
    recipe = recipe_of_method(stored.header.method, stored.header.recipe, str(opened.file))
    frozen = relight_recipe(recipe, steps)
    if not isinstance(stored.model, SplatModel):
        raise RecipeError(f"{opened.file}: is not made of Gaussians, so its light cannot be learned alone; train anew")
    refuse_unlit(stored.model)

    def checked(preset: str, scene: Scene) -> None:
        refuse_other_cameras(scene, stored)
        loaded(preset, scene)

    def prepared(run: PreparedRun) -> None:
        if isinstance(run.training.model, SplatModel) and isinstance(run.training.model.color, SharedBasis):
            recolor(run.training.model, run.scene)

    _, options = recorded_scene(opened)
    model = opened.file if opened.run is None else opened.run.path
    return start_run(out, photographs, stored.header.preset, frozen, options, seed, device, model, checked, prepared)


def refuse_other_cameras(scene: Scene, stored: StoredModel) -> None:
    """Raise RunError unless some photographs are from cameras that the model was trained with, at their size."""
    if not stored.cameras:
        return
    extent = stored.header.scene.extent
    apart = distances([view.camera for view in scene.train], stored.cameras)
    same = [view for view, gap in zip(scene.train, apart, strict=True) if gap <= SAME_PLACE * extent]
    if not same:
        raise RunError(
            f"{scene.source}: none of its cameras is one that the model was trained with; give photographs from the "
            "same places, with cameras in the same world"
        )
    width, height = stored.header.scene.resolution
    camera = same[0].camera
    if (camera.width, camera.height) != (width, height):
        raise RunError(
            f"{scene.source}: its photographs are {camera.width} x {camera.height}, and the model's were {width} x "
            f"{height}; give photographs of that size"
        )


@torch.no_grad()
def recolor(model: SplatModel, scene: Scene) -> None:
    """Bring a shared basis near the photographs by one affine change of all its colours, before the first step.

    Base colours are each Gaussian's own, so that nothing that is shared would change them. Pictures are sums of
    colours: the change that takes pictures to photographs, least squares, is that of the colours.
    """
    background, seen, wanted = scene.background_color, [], []
    for view in counted("matching colours", _evenly(scene.train, COLOR_VIEWS)):
        shown = model.render(view.camera, torch.zeros(3), Want.EXACT)
        photograph = view.image(background).permute(1, 2, 0).double()
        alpha = shown.alpha.cpu().double()
        seen.append(torch.cat([shown.color.cpu().double(), alpha], -1).flatten(0, 1).numpy())
        wanted.append((photograph - (1 - alpha) * background.double()).flatten(0, 1).numpy())
    colors = least_squares(np.concatenate(seen), np.concatenate(wanted))
    basis = model.get_parameter(COLOR + BASIS)
    changed = sum(basis[..., k, None].double() * colors[:, k].double().to(basis.device) for k in range(3))
    assert isinstance(changed, torch.Tensor)
    basis.copy_(changed)
    constant = model.columns[DC]
    constant.copy_(transformed(constant, colors))


def finish_relighting(folder: RunFolder) -> PackReport:
    """Write the pack of a run that is complete.

    Raises RunError where the folder is no such run, is not complete, or the model that it started from has changed.
    """
    record = RunRecord.read(folder.path)
    again = command("relight", "--resume", folder.path)
    start = refuse_other_runs(folder.path, record)
    own = load_model(folder.path, host_rasterizer())
    if own.header.step < record.steps:
        raise RunError(f"{folder.path}: is not complete yet; go on with: {again}")
    try:
        model = open_model(start)
    except (ModelFileError, RunError) as error:
        raise RunError(f"{error}; the pack belongs to that model: put it back, then: {again}") from None
    tensors = own.model.rendering_tensors()
    pack = pack_between(model.stored, tensors, own.header.scene.name, folder.path / PACK_NAME)
    size = write_pack(pack)
    decibels = _picture_loss(relit(model.stored, pack, model.file), own)
    mean = metrics.psnr_of_different(decibels) if decibels else None
    return PackReport(str(pack.path), size, len(pack.tensors), len(decibels), mean)


def refuse_other_runs(path: Path, record: RunRecord) -> Path:
    """The model that the run relights. Raises RunError where it does not."""
    if record.start is None or not relights(record):
        raise RunError(f"{path}: does not relight a model; make such a run by: ringlight relight MODEL PHOTOS OUT")
    return Path(record.start)


def relights(record: RunRecord) -> bool:
    """Whether it is a run that :func:`start_relighting` began, going by its recipe."""
    try:
        return record.start is not None and relight_recipe(record.recipe, record.recipe.steps) == record.recipe
    except RecipeError:
        return False


@torch.no_grad()
def _picture_loss(packed: StoredModel, own: StoredModel) -> list[float]:
    background = torch.zeros(3) if own.header.scene.background == "black" else torch.ones(3)
    cameras = counted("comparing pictures", _evenly(own.cameras, MOST_PICTURES))
    return [
        metrics.psnr(*(one.model.render(camera, background, Want.EXACT).color.clamp(0, 1) for one in (packed, own)))
        for camera in cameras
    ]


def _evenly(items: Sequence[Item], most: int) -> list[Item]:
    count = min(len(items), most)
    return [items[index * len(items) // count] for index in range(count)]
