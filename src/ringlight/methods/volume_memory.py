"""What a volume's training takes of memory, and what is refused of it before it begins."""

import math

import torch
from jaxtyping import Bool

from ringlight.core.memory import machine_memory
from ringlight.core.randomness import generator
from ringlight.core.scene import Scene
from ringlight.core.words import MEGABYTE
from ringlight.data.rays import RayBatches
from ringlight.errors import RecipeError
from ringlight.fit.room import memory_of
from ringlight.methods.volume_recipe import VolumeRecipe
from ringlight.volume.model import VolumeModel

SHARE = 0.5
"""Of the memory of the device that draws, for the grid and for the samples of a step, and of the machine's for the
photographs' pixels and rays, each by itself."""

FLOAT_BYTES = 4

COUNTED = 1 << 16
"""Rays whose samples are counted: what they have on average is known to a percent."""

MOST_SAMPLES = (1 << 31) - 1
"""Of a step: kernels count them by 32 bits."""


def memory_for_a_volume(device: torch.device) -> int:
    """Bytes that its grid may take while it trains, and the samples of a step."""
    return int(SHARE * memory_of(device))


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
        return FLOAT_BYTES * recipe.numbers_at(box, side)

    side = recipe.final_side
    if bytes_of(side) <= memory:
        return
    fits = next((side for side in recipe.smaller_sides if bytes_of(side) <= memory), None)
    raise RecipeError(
        f"a grid of {recipe.in_words(side)} takes {bytes_of(side) / MEGABYTE:,.0f} MB while it trains, and {SHARE:.0%} "
        f"of this device's memory is {memory / MEGABYTE:,.0f} MB; "
        f"{recipe.lighter if fits is None else recipe.remedy(fits)}"
    )


def refuse_too_many_rays(recipe: VolumeRecipe, model: VolumeModel) -> None:
    """Raise RecipeError for rays of which kernels cannot count the samples, if all go through the whole box: before
    anything is known of what is empty. ``model`` is as it is at the start."""
    of_ray = math.ceil(model.space().most * recipe.finer(model.nodes))
    most = max(MOST_SAMPLES // of_ray, 1)
    if recipe.rays > most:
        raise RecipeError(
            f"rays is {recipe.rays}; each has up to {of_ray:,} samples in a grid of "
            f"{recipe.in_words(recipe.final_side)}, and {most} rays are the most whose samples are counted; give as "
            "many or fewer"
        )


def refuse_too_many_samples(
    recipe: VolumeRecipe, model: VolumeModel, batches: RayBatches, met: Bool[torch.Tensor, "P"], memory: int
) -> None:
    """Raise RecipeError, with the most that fit, for rays whose samples ``memory`` bytes cannot hold.

    Counted are those of some of the rays that will be drawn, ``met`` of all, in what is not known to be empty yet; in a
    fog each of them has a colour.
    """
    some = torch.randint(len(met), (COUNTED,), generator=generator(batches.seed, 0, "counted rays"))
    some = some[met[some]]
    if not len(some):
        return
    of_ray = model.samples_of(batches.through(some), recipe.finer(model.nodes)).double().mean().item()
    of_each = FLOAT_BYTES * recipe.numbers_of_sample * max(of_ray, 1.0)
    most = max(int(memory / of_each), 1)
    if recipe.rays > most:
        raise RecipeError(
            f"rays is {recipe.rays}; the samples of as many take up to {recipe.rays * of_each / MEGABYTE:,.0f} MB in a "
            f"grid of {recipe.in_words(recipe.final_side)}, and {SHARE:.0%} of this device's memory is "
            f"{memory / MEGABYTE:,.0f} MB; {most} rays are the most that fit; give as many or fewer"
        )
