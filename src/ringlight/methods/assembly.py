"""From a recipe that splats Gaussians to its model and its training: what all such methods do alike."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.core.light_features import FeatureShares
from ringlight.core.scene import PointCloud, Scene
from ringlight.data.batches import COARSE, ImageBatches
from ringlight.data.dropout import Dropout
from ringlight.fit.guard import Guard
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.regularizers.mean_opacity import MeanOpacity
from ringlight.fit.regularizers.mean_scale import MeanScale
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.strategies.contract import DensityControl, Strategy
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.strategies.mcmc import MCMC
from ringlight.fit.strategies.mcmc_settings import PAPER_EXTENT
from ringlight.fit.strategies.unlock import Unlock
from ringlight.fit.train import Training
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.models.feature_shares import feature_shares
from ringlight.models.initial import INITIAL_OPACITY, gaussians_from_points
from ringlight.models.splats import SplatModel
from ringlight.rasterize.contract import Rasterizer, RasterOptions


@dataclass(frozen=True, kw_only=True)
class Course:
    """How a recipe's parts are trained, besides what all recipes have as settings.

    ``groups`` are Adam's by parameter name, but for the geometry; ``unlocks`` are the buffers that begin at zero, and
    what each becomes at which step; ``surface_opacity`` is that of first Gaussians on points whose normals are known.
    """

    groups: dict[str, Adam]
    unlocks: Mapping[str, Mapping[int, int]] = field(default_factory=dict)
    surface_opacity: float = INITIAL_OPACITY
    coarse_steps: int = 0
    light: tuple[str, ...] = ()
    """How names of the light's parameters begin, if it can collapse and a guard is to undo that."""
    first_lit: int = 1
    """Step after which the light is on."""
    last: Callable[[DensityControl, int], tuple[Strategy, ...]] = lambda _control, _seed: ()
    """What comes after density control, by that and the run's seed."""
    regularizers: Mapping[str, Regularizer] = field(default_factory=dict)


def empty_model(recipe: SplatRecipe, box: Float[Tensor, "2 3"], rasterize: Rasterizer) -> SplatModel:
    """The model without a Gaussian: what a file's tensors are loaded into."""
    color, shader = recipe.parts(box)
    with torch.device("cpu"):  # whoever wants only shapes asks for the networks on torch's meta device
        none = PointCloud(torch.zeros(0, 3), torch.zeros(0, 3))
        columns = color.new_columns(none)
        table = Gaussians(none.positions, torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0), columns)
    return SplatModel(table, color, shader, rasterize, RasterOptions(antialiased=recipe.antialiased))


def assembled(recipe: SplatRecipe, points: PointCloud, scene: Scene, rasterize: Rasterizer, seed: int) -> Training:
    """The model at its start, a Gaussian on each of the ``points``, and everything that trains it.

    Without a bound in its settings density control ends with as many Gaussians as suit the photographs' pixels.
    """
    recipe = recipe.at_length()
    course, (color, shader) = recipe.course(scene), recipe.parts(scene.box, seed)
    opacity = INITIAL_OPACITY if points.normals is None else course.surface_opacity
    table, options = gaussians_from_points(points, color, opacity), RasterOptions(antialiased=recipe.antialiased)
    model = SplatModel(table, color, shader, rasterize, options)
    for buffer in course.unlocks:
        model.get_buffer(buffer).zero_()
    steps, densify = recipe.steps, recipe.densify.within(recipe.most_by_pixels(scene.pixels))
    groups = recipe.rates.groups(scene.extent) | course.groups
    growing = density_control(densify, scene, steps, seed, guarded=bool(course.light))
    dropping = DropLeast(densify, [view.camera for view in scene.train], steps, scene.background_color, seed)
    share = recipe.dropout_of(len(scene.train))
    dropout = Dropout(share, recipe.last_whole_step) if share else None
    averages = () if recipe.averaged_from is None else (AverageAtEnd(recipe.averaged_from, steps),)
    return Training(
        model=model,
        batches=ImageBatches(scene, seed, course.coarse_steps, dropout),
        loss=PhotographLoss(recipe.loss, rasterize.device),
        optimizer=Optimizer(model, groups, steps, recipe.visible_only),
        strategies=(
            *(Unlock(buffer, schedule) for buffer, schedule in course.unlocks.items()),
            growing,
            dropping,
            *course.last(growing, seed),
            *averages,
        ),
        steps=steps,
        regularizers={**course.regularizers, **penalties(densify, scene, recipe.loss.scale)},
        guard=_guard(course, model, scene, disturbed_steps(course, growing, dropping, steps)) if course.light else None,
        origin=points.origin,
    )


def density_control(
    settings: DensifySettings, scene: Scene, steps: int, seed: int, guarded: bool = False
) -> DensityControl:
    """What decides where Gaussians are wanted, of the kind that the settings name. ``guarded``: the training keeps an
    earlier state besides."""
    if settings.kind == "mcmc":
        cameras = [view.camera for view in scene.train]
        return MCMC(settings, scene.extent, cameras, scene.background_color, steps, seed)
    return Densify(settings, scene.extent, steps, seed, white=scene.background == "white", guarded=guarded)


def penalties(settings: DensifySettings, scene: Scene, scale: float) -> dict[str, Regularizer]:
    """What density control adds to a loss of this ``scale``, by name."""
    if settings.kind == "adaptive":
        return {}
    terms: dict[str, Regularizer] = {}
    if settings.mcmc.opacity_penalty:
        terms["opacity"] = MeanOpacity(scale * settings.mcmc.opacity_penalty)
    if settings.mcmc.scale_penalty:
        terms["size"] = MeanScale(scale * settings.mcmc.scale_penalty * PAPER_EXTENT / scene.extent)
    return terms


def disturbed_steps(course: Course, growing: DensityControl, dropping: DropLeast, steps: int) -> frozenset[int]:
    """After which the loss rises for good reasons: opacities are reset, Gaussians dropped, photographs larger, or
    something new is shown. The light itself is none: it must not make the picture worse."""
    coarse = course.coarse_steps
    shown = (schedule.keys() for schedule in course.unlocks.values())
    others = {step for steps in shown for step in steps} - {course.first_lit}
    larger = {coarse * stage for stage in range(1, len(COARSE) + 1)} if coarse else set()
    return dropping.rounds | others | larger | {step for step in range(1, steps + 1) if growing.resets(step)}


def _guard(course: Course, model: SplatModel, scene: Scene, disturbed: frozenset[int]) -> Guard:
    cameras = [view.camera for view in scene.train]

    def look(index: int) -> FeatureShares | None:
        return feature_shares(model, [cameras[index % len(cameras)]], scene.background_color)

    return Guard(course.light, course.first_lit, look, disturbed)
