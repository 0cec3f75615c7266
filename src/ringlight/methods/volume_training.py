"""Makes a training of a volume's recipe: its model, rays, loss, and schedules."""

import torch

from ringlight.core.scene import Scene
from ringlight.data.rays import RayBatches
from ringlight.errors import RecipeError
from ringlight.fit.losses.rays import RayLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.strategies.draw_by_error import DrawByError
from ringlight.fit.strategies.empty_space import EmptySpace
from ringlight.fit.strategies.refine_grid import RefineGrid
from ringlight.fit.train import Training
from ringlight.methods.volume_box import subject_masks
from ringlight.methods.volume_carving import carved, limit_of
from ringlight.methods.volume_memory import (
    memory_for_a_volume,
    refuse_too_large,
    refuse_too_many_pixels,
    refuse_too_many_rays,
    refuse_too_many_samples,
)
from ringlight.methods.volume_recipe import VolumeRecipe, on_device
from ringlight.methods.wrong_masks import mended
from ringlight.rasterize.contract import Rasterizer
from ringlight.volume.marching import meets_box


def volume_training(recipe: VolumeRecipe, scene: Scene, rasterize: Rasterizer, seed: int) -> Training:
    """The model at its start, and everything that trains it. ``recipe`` has its bounds.

    Raises RecipeError for a grid, photographs or rays that memory cannot hold, and for a box that no ray meets.
    """
    assert recipe.bounds is not None
    box = torch.tensor(recipe.bounds).view(2, 3)
    memory = memory_for_a_volume(rasterize.device)
    refuse_too_large(recipe, box, memory)
    refuse_too_many_pixels(scene)
    model = recipe.first_model(box, seed)
    refuse_too_many_rays(recipe, model)
    model.gradient_share = recipe.gradient_share
    masks = subject_masks(scene)[0] if recipe.carve else []
    left = carved(masks, box, recipe.longest_side)
    if left is not None:
        model.skip_all_but(left)
    on_device(model, rasterize)
    emptied = recipe.emptied
    varied = emptied[0] if scene.background == "black" else 0
    batches = RayBatches(scene, recipe.rays, seed, varied, recipe.by_error)
    met = batches.looked_at(model.meets_something if left is not None else lambda rays: meets_box(rays, box))
    more = None if left is None else mended(left, met, model, masks, scene, batches)
    if more is not None:
        left = more
        model.skip_all_but(left)
        met = batches.looked_at(model.meets_something)
    if not met.any():
        corners = " ".join(f"{value:.3g}" for value in recipe.bounds)
        raise RecipeError(f"no ray of a photograph meets the box {corners}; give other --bounds, or none")
    refuse_too_many_samples(recipe, model, batches, met, memory)
    if not met.all():
        batches.keep(met)
    averages = () if recipe.averaged_from is None else (AverageAtEnd(recipe.averaged_from, recipe.steps),)
    optimizer = Optimizer(model, recipe.groups(), recipe.steps)
    return Training(
        model=model,
        batches=batches,
        loss=RayLoss(batches),
        optimizer=optimizer,
        strategies=(
            EmptySpace(batches, emptied, None if left is None else limit_of(box, left)),
            RefineGrid(recipe.refined),
            *recipe.stepped_by(optimizer, model),
            *averages,
            *(() if batches.errors is None else (DrawByError(batches),)),
        ),
        steps=recipe.steps,
        regularizers=recipe.terms(model, seed),
    )
