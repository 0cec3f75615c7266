"""From a recipe that splats Gaussians to its model and its training: what all such methods do alike."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud, Scene
from ringlight.data.batches import ImageBatches
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.strategies.unlock import Unlock
from ringlight.fit.train import Training
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.models.initial import INITIAL_OPACITY, gaussians_from_points
from ringlight.models.splats import SplatModel
from ringlight.rasterize.contract import Rasterizer, RasterOptions


@dataclass(frozen=True, kw_only=True)
class Course:
    """How a recipe's parts are trained, besides what all recipes have as settings.

    ``groups`` are Adam's by parameter name, but for the geometry; ``unlocks`` are the buffers that begin at zero, and
    what each becomes at which step; ``surface_opacity`` is that of first Gaussians on points whose normals are known;
    ``last`` comes after density control.
    """

    groups: dict[str, Adam]
    unlocks: Mapping[str, Mapping[int, int]] = field(default_factory=dict)
    surface_opacity: float = INITIAL_OPACITY
    coarse_steps: int = 0
    last: tuple[Strategy, ...] = ()
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

    Without a bound in its settings density control ends with as many Gaussians as the largest photograph has pixels.
    """
    recipe = recipe.at_length()
    course, (color, shader) = recipe.course(scene), recipe.parts(scene.box, seed)
    opacity = INITIAL_OPACITY if points.normals is None else course.surface_opacity
    table, options = gaussians_from_points(points, color, opacity), RasterOptions(antialiased=recipe.antialiased)
    model = SplatModel(table, color, shader, rasterize, options)
    for buffer in course.unlocks:
        model.get_buffer(buffer).zero_()
    steps, densify = recipe.steps, recipe.densify.within(scene.pixels)
    groups = recipe.rates.groups(scene.extent) | course.groups
    return Training(
        model=model,
        batches=ImageBatches(scene, seed, course.coarse_steps),
        loss=PhotographLoss(recipe.loss, rasterize.device),
        optimizer=Optimizer(model, groups, steps, recipe.visible_only),
        strategies=(
            *(Unlock(buffer, schedule) for buffer, schedule in course.unlocks.items()),
            Densify(densify, scene.extent, steps, seed, white=scene.background == "white"),
            DropLeast(densify, [view.camera for view in scene.train], steps),
            *course.last,
        ),
        steps=steps,
        regularizers=course.regularizers,
    )
