"""Makes a training of a volume's recipe: what a grid of its size takes, its rays, loss, and schedules."""

import math

import torch

from ringlight.core.memory import machine_memory
from ringlight.core.scene import Scene
from ringlight.core.words import MEGABYTE
from ringlight.data.rays import RayBatches
from ringlight.errors import RecipeError
from ringlight.fit.losses.rays import RayLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.room import memory_of
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.strategies.draw_by_error import DrawByError
from ringlight.fit.strategies.empty_space import EmptySpace
from ringlight.fit.strategies.refine_grid import RefineGrid
from ringlight.fit.train import Training
from ringlight.methods.volume_box import subject_masks
from ringlight.methods.volume_carving import carved, limit_of
from ringlight.methods.volume_recipe import VolumeRecipe
from ringlight.methods.wrong_masks import mended
from ringlight.rasterize.contract import Rasterizer
from ringlight.volume.marching import meets_box
from ringlight.volume.model import VolumeModel

SHARE = 0.5
"""Of the memory of the device that draws, for the grid and for the samples of a step, and of the machine's for the
photographs' pixels and rays, each by itself."""

SAMPLE_BYTES = 32
"""Place, distance, weight, light that is left, slope and gradient of a sample, whether it has a colour or not."""

MOST_SAMPLES = (1 << 31) - 1
"""Of a step: kernels count them by 32 bits."""


def volume_training(recipe: VolumeRecipe, scene: Scene, rasterize: Rasterizer, seed: int) -> Training:
    """The model at its start, and everything that trains it. ``recipe`` has its bounds.

    Raises RecipeError for a grid that memory cannot hold, and for a box that no ray meets.
    """
    assert recipe.bounds is not None
    box = torch.tensor(recipe.bounds).view(2, 3)
    memory = int(SHARE * memory_of(rasterize.device))
    refuse_too_large(recipe, box, memory)
    refuse_too_many_pixels(scene)
    model = recipe.first_model(box, seed)
    refuse_too_many_rays(recipe, model, memory)
    model.gradient_share = recipe.gradient_share
    masks = subject_masks(scene)[0] if recipe.carve else []
    left = carved(masks, box, recipe.longest_side)
    if left is not None:
        model.skip_all_but(left)
    model.to(rasterize.device)
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


def refuse_too_many_pixels(scene: Scene) -> None:
    """Raise RecipeError for photographs whose pixels memory cannot hold: rays are drawn from all of them."""
    size = RayBatches.bytes_of(sum(view.camera.width * view.camera.height for view in scene.train))
    memory = int(SHARE * machine_memory())
    if size > memory:
        raise RecipeError(
            f"the photographs' pixels and their rays take {size / MEGABYTE:,.0f} MB, and {SHARE:.0%} of this machine's "
            f"memory is {memory / MEGABYTE:,.0f} MB; a volume draws rays from all of them: try --downscale 2"
        )


def refuse_too_large(recipe: VolumeRecipe, box: torch.Tensor, memory: int) -> None:
    """Raise RecipeError, with the largest side that fits, for a grid whose training ``memory`` bytes cannot hold."""

    def bytes_of(side: int) -> int:
        return 4 * recipe.numbers_at(box, side)

    side = recipe.final_side
    if bytes_of(side) <= memory:
        return
    fits = next((side for side in recipe.smaller_sides if bytes_of(side) <= memory), None)
    raise RecipeError(
        f"a grid of {recipe.in_words(side)} takes {bytes_of(side) / MEGABYTE:,.0f} MB while it trains, and {SHARE:.0%} "
        f"of this device's memory is {memory / MEGABYTE:,.0f} MB; "
        f"{recipe.lighter if fits is None else recipe.remedy(fits)}"
    )


def refuse_too_many_rays(recipe: VolumeRecipe, model: VolumeModel, memory: int) -> None:
    """Raise RecipeError, with the most that fit, for rays whose samples ``memory`` cannot hold, or kernels not count.

    Counted are those of rays through the whole box: what is empty is not known yet. ``model`` is as it is at the start.
    """
    of_ray = math.ceil(model.space().most * recipe.finer(model.nodes))
    most = min(memory // (SAMPLE_BYTES * of_ray), MOST_SAMPLES // of_ray)
    if recipe.rays > max(most, 1):
        raise RecipeError(
            f"rays is {recipe.rays}; each has up to {of_ray:,} samples in a grid of "
            f"{recipe.in_words(recipe.final_side)}, and {max(most, 1)} rays are the most that fit; give as many or "
            "fewer"
        )
