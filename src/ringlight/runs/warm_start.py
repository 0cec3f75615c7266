"""A training that starts from a model instead of points: with all of it, or with its table of Gaussians."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ringlight.color.shared_basis import WEIGHTS
from ringlight.color.varying_mirror import OPACITY_BASES
from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.scene import PointCloud, Scene
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, rgb_from_sh
from ringlight.errors import RecipeError, RunError
from ringlight.fit.room import SHARE, most_rows
from ringlight.fit.train import Training
from ringlight.methods.recipe import Recipe
from ringlight.methods.ringlight import SHADINGS, RingLightRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.store import StoredModel
from ringlight.methods.table import CHOOSERS, method_of
from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.methods.warmup import WARMUP
from ringlight.models.narrowed_splats import REST
from ringlight.models.splats import SplatModel
from ringlight.runs.imported import PLY, model_of_ply
from ringlight.runs.opened import open_model
from ringlight.shade.reflection import ReflectionShader

HARMONICS = ("3dgs", "light-gaussian")
"""Methods whose models have the same tensors; each takes those of the other whole."""


@dataclass(frozen=True)
class Start:
    """A model to start from, and the file or run folder that held it."""

    path: Path
    stored: StoredModel


def read_start(path: Path) -> Start:
    """From a PLY, a model file or a run folder. Raises ModelFileError, RunError, or RecipeError for a model whose grid
    is refined while it trains: no run begins with the finest."""
    if path.suffix.lower() == PLY and not path.is_dir():
        return Start(path, model_of_ply(path))
    start = Start(path, open_model(path).stored)
    if start.stored.model.resized_prefixes:
        raise RecipeError(
            f"{path}: is a model of {start.stored.header.method}, whose grid begins coarse: no run can start from it; "
            "leave out --from, or go on with its own run: ringlight train --resume RUN --steps N"
        )
    return start


def settled_like(recipe: Recipe, start: Start) -> Recipe:
    """The recipe, or where it would choose a method by the scene, with the start's method if that is one of them; what
    was trained as 3dgs by itself, as PLYs are, leaves the choice."""
    header = start.stored.header
    if isinstance(recipe, RingLightRecipe) and recipe.shading == "auto":
        for shading, (method, _) in SHADINGS.items():
            if method == header.method and (shading != "harmonics" or header.preset in CHOOSERS):
                return _with_maps_of(recipe.chosen(shading), start)
    return _with_maps_of(recipe, start)


def _with_maps_of(recipe: Recipe, start: Start) -> Recipe:
    """The recipe; of a mirror that leaves its maps to the photographs, with those of a start that is one."""
    source = start.stored.model.splats()
    shader = None if source is None else source.shader
    if not isinstance(recipe, RingLightMirrorRecipe) or not isinstance(shader, ReflectionShader):
        return recipe
    return replace(recipe, shader=recipe.shader.for_levels(shader.settings.sides))


LEARNED_ALREADY = {"coarse_steps": 0}
"""Settings of a run that starts from any model: what it shows is not learned again from small photographs."""

GROWN_ALREADY = LEARNED_ALREADY | {"grow_share": 0.0}
"""Settings of one that goes on from a model of harmonics: neither are its Gaussians grown again."""


def going_on(recipe: Recipe, start: Start) -> Recipe:
    """The recipe without what the start has behind it; axes of another method's Gaussians are no normals, and wait for
    the reflection as those of points do."""
    named: Any = recipe
    known = {field.name for field in fields(named)}
    settings = GROWN_ALREADY if start.stored.header.method in HARMONICS else LEARNED_ALREADY
    if isinstance(recipe, ThreeDGSDRRecipe) and start.stored.header.method != method_of(recipe):
        settings = settings | {"warmup": WARMUP if recipe.warmup is None else recipe.warmup}
    return replace(named, **{name: value for name, value in settings.items() if name in known})


def begin_with(training: Training, recipe: Recipe, scene: Scene, start: Start) -> None:
    """Put the start into a training at its first step: every tensor where its method has the same, else the table of
    Gaussians with their base colours; whatever else a colour has begins as the method begins it.

    Raises RecipeError where the start has another form than this method's models, RunError for one that this machine
    has no memory for, or that no photograph shows.
    """
    model = training.model
    rows, most = start.stored.model.counted(), most_rows(model, guarded=training.guard is not None)
    if rows.number > most:
        raise RunError(f"{start.path}: has {rows}, and {SHARE:.0%} of this machine's memory holds {most:,}; prune it")
    methods = {start.stored.header.method, method_of(recipe)}
    if len(methods) == 1 or methods == set(HARMONICS):
        model.load_tensors(_all_of(start, training, recipe))
    else:
        model.load_tensors(model.state_dict() | _table_of(start, training))
    _refuse_unseen(model.splats(), scene, start)
    training.optimizer.begin_anew()
    training.origin = None


def _all_of(start: Start, training: Training, recipe: Recipe) -> dict[str, Tensor]:
    """Every tensor of the start, and columns that only training needs as they begin."""
    model, own, found = training.model, training.model.state_dict(), dict(start.stored.model.state_dict())
    splats, source = model.splats(), start.stored.model.splats()
    if splats is not None and source is not None and own.keys() - found.keys():
        new = splats.color.new_columns(colored_points(source))
        found |= {COLUMNS + name: column for name, column in new.items() if COLUMNS + name not in found}
    for name in own.keys() & OPACITY_BASES:  # a model without them shows what one with zeros does
        found.setdefault(name, torch.zeros_like(own[name]))
    for name in (found.keys() - own.keys()) & set(OPACITY_BASES):
        mixes = COLUMNS + WEIGHTS in own
        remedy = "leave --no-varying-opacity away" if mixes else f"give --basis-size {len(found[name])}"
        raise RecipeError(f"{start.path}: its opacities change with the view; {remedy}")
    for name, tensor in own.items():
        other = found.get(name)
        skip = 1 if name.startswith(model.row_prefixes) else 0
        if other is None or other.shape[skip:] != tensor.shape[skip:]:
            shape = "none" if other is None else f"one of shape {list(other.shape[skip:])}"
            raise RecipeError(
                f"{start.path}: this run has a {name} of shape {list(tensor.shape[skip:])}, and the model {shape}; "
                f"give {_same_form(name, other, recipe)}, or another method, which takes the Gaussians alone"
            )
    return {name: found[name] for name in own}


def _same_form(name: str, stored: Tensor | None, recipe: Recipe) -> str:
    """What gives a run the form of the start's tensor. Its own settings tell no degree that files are cut to, as those
    of light-gaussian."""
    named: Any = recipe
    if name == REST and stored is not None and "sh_degree" in {field.name for field in fields(named)}:
        for degree in range(MAX_DEGREE + 1):
            if basis_count(degree) - 1 == stored.shape[1]:
                return f"--sh-degree {degree}"
    return "the settings that 'ringlight info' shows"


def _table_of(start: Start, training: Training) -> dict[str, Tensor]:
    """The columns that this training's model has: the start's geometry, and its base colours in the model's form."""
    splats, source = training.model.splats(), start.stored.model.splats()
    if splats is None or source is None:
        raise RecipeError(
            f"{start.path}: is a model of {start.stored.header.method}, and another method can only start from a table "
            "of Gaussians, which one of the two has not; train the same method"
        )
    table = source.gaussians.rows(_shown_rows(source))
    columns = replace(table, appearance=splats.color.new_columns(colored_points(source))).columns()
    return {COLUMNS + name: column.detach().cpu() for name, column in columns.items()}


def _shown_rows(source: SplatModel) -> Tensor:
    return source.color.wanted(source.gaussians).nonzero()[:, 0]


@torch.no_grad()
def colored_points(source: SplatModel) -> PointCloud:
    """Centres and base colours of the Gaussians that the model shows; of harmonics what is the same from all sides."""
    table = source.gaussians.rows(_shown_rows(source))
    camera = Camera(torch.eye(4), (1.0, 1.0), (0.5, 0.5), 1, 1)
    if "sh_dc" in table.appearance:  # a layer "base" of theirs may be what they show towards the camera
        colors = rgb_from_sh(table.appearance["sh_dc"])
    else:
        layers = source.color.layers(table, camera)
        colors = layers["base"] if "base" in layers else source.emitted(table, camera)
    return PointCloud(table.means.detach().cpu(), colors.detach().cpu().clamp(0, 1))


def _refuse_unseen(splats: SplatModel | None, scene: Scene, start: Start) -> None:
    """Raise RunError where no training camera sees a Gaussian: the model is of another scene, or of another world."""
    if splats is None:
        return
    means = splats.gaussians.means.detach()
    if not any(bool(view.camera.pixels(means)[2].any()) for view in scene.train):
        raise RunError(
            f"{start.path}: no training photograph of {scene.source} shows a Gaussian of it; it is of another scene, "
            "or in another world: give a model of this scene in its own coordinates"
        )
