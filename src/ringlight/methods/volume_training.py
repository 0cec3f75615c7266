"""Makes a training of a volume's recipe: what a grid of its size takes, its rays, loss, and schedules."""

import torch

from ringlight.core.memory import machine_memory
from ringlight.core.scene import Scene
from ringlight.core.words import MEGABYTE
from ringlight.data.rays import RayBatches
from ringlight.errors import RecipeError
from ringlight.fit.losses.rays import RayLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.strategies.empty_space import EmptySpace
from ringlight.fit.strategies.refine_grid import RefineGrid
from ringlight.fit.train import Training
from ringlight.methods.volume_box import subject_masks
from ringlight.methods.volume_carving import carved
from ringlight.methods.volume_recipe import VolumeRecipe
from ringlight.rasterize.contract import Rasterizer
from ringlight.volume.marching import meets_box

SHARE = 0.5
"""Of the machine's memory for the grid; photographs, samples of rays and the system share the rest."""


def volume_training(recipe: VolumeRecipe, scene: Scene, rasterize: Rasterizer, seed: int) -> Training:
    """The model at its start, and everything that trains it. ``recipe`` has its bounds.

    Raises RecipeError for a grid that memory cannot hold, and for a box that no ray meets.
    """
    assert recipe.bounds is not None
    box = torch.tensor(recipe.bounds).view(2, 3)
    refuse_too_large(recipe, box)
    model = recipe.first_model(box, seed)
    model.gradient_share = recipe.gradient_share
    carving = carved(subject_masks(scene)[0], box, recipe.final_side) if recipe.carve else None
    if carving is not None:
        model.skip_all_but(carving)
    model.to(rasterize.device)
    emptied = recipe.emptied
    batches = RayBatches(scene, recipe.rays, seed, emptied[0] if scene.background == "black" else 0)
    met = batches.looked_at(model.meets_something if carving is not None else lambda rays: meets_box(rays, box))
    if not met.any():
        corners = " ".join(f"{value:.3g}" for value in recipe.bounds)
        raise RecipeError(f"no ray of a photograph meets the box {corners}; give other --bounds, or none")
    if not met.all():
        batches.keep(met)
    averages = () if recipe.averaged_from is None else (AverageAtEnd(recipe.averaged_from, recipe.steps),)
    return Training(
        model=model,
        batches=batches,
        loss=RayLoss(batches),
        optimizer=Optimizer(model, recipe.groups(), recipe.steps),
        strategies=(EmptySpace(batches, emptied), RefineGrid(recipe.refined), *averages),
        steps=recipe.steps,
        regularizers=recipe.terms(model),
    )


def refuse_too_large(recipe: VolumeRecipe, box: torch.Tensor) -> None:
    """Raise RecipeError, with the largest side that fits, for a grid whose training memory cannot hold."""
    memory = int(SHARE * machine_memory())

    def bytes_of(side: int) -> int:
        return 4 * recipe.numbers_at(box, side)

    side = recipe.final_side
    if bytes_of(side) <= memory:
        return
    smaller = recipe.smaller_sides
    fits = next((side for side in smaller if bytes_of(side) <= memory), smaller[-1])
    raise RecipeError(
        f"a grid of {side} cubed takes {bytes_of(side) / MEGABYTE:,.0f} MB while it trains, and {SHARE:.0%} of this "
        f"machine's memory is {memory / MEGABYTE:,.0f} MB; {recipe.remedy(fits)}"
    )
