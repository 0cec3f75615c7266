"""Makes a training of a volume's recipe: what a grid of its size takes, its rays, loss, and schedules."""

from typing import TYPE_CHECKING

import torch

from ringlight.core.memory import machine_memory
from ringlight.core.scene import Scene
from ringlight.core.words import MEGABYTE
from ringlight.data.rays import RayBatches
from ringlight.errors import RecipeError
from ringlight.fit.losses.rays import RayLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.regularizers.factor_size import FactorSize
from ringlight.fit.regularizers.factor_variation import FactorVariation
from ringlight.fit.strategies.empty_space import EmptySpace
from ringlight.fit.strategies.refine_grid import RefineGrid
from ringlight.fit.train import Training
from ringlight.methods.volume_box import subject_masks
from ringlight.methods.volume_carving import carved
from ringlight.rasterize.contract import Rasterizer
from ringlight.volume.grids import growing, sides_of
from ringlight.volume.marching import meets_box

if TYPE_CHECKING:
    from ringlight.methods.tensorf import TensorfRecipe

SHARE = 0.5
"""Of the machine's memory for the grid; photographs, samples of rays and the system share the rest."""

COPIES = 6
"""Of a grid while it trains: values, gradients, those of a regularizer, two moments, and one while it is refined."""


def volume_training(recipe: "TensorfRecipe", scene: Scene, rasterize: Rasterizer, seed: int) -> Training:
    """The model at its start, and everything that trains it. ``recipe`` has its bounds.

    Raises RecipeError for a grid that memory cannot hold, and for a box that no ray meets.
    """
    from ringlight.methods.tensorf import EMPTIED, REFINED

    assert recipe.bounds is not None
    box = torch.tensor(recipe.bounds).view(2, 3)
    refuse_too_large(recipe, box)
    model = recipe.model_of(sides_of(box, recipe.first_side**3), box, seed)
    carving = carved(subject_masks(scene)[0], box, recipe.final_side) if recipe.carve else None
    if carving is not None:
        model.skip_all_but(carving)
    model.to(rasterize.device)
    emptied = tuple(dict.fromkeys(recipe.at_share(EMPTIED)))
    batches = RayBatches(scene, recipe.rays, seed, emptied[0] if scene.background == "black" else 0)
    met = batches.looked_at(model.meets_something if carving is not None else lambda rays: meets_box(rays, box))
    if not met.any():
        corners = " ".join(f"{value:.3g}" for value in recipe.bounds)
        raise RecipeError(f"no ray of a photograph meets the box {corners}; give other --bounds, or none")
    if not met.all():
        batches.keep(met)
    voxels = dict(
        zip(recipe.at_share(REFINED), growing(recipe.first_side, recipe.final_side, len(REFINED)), strict=True)
    )
    return Training(
        model=model,
        batches=batches,
        loss=RayLoss(batches),
        optimizer=Optimizer(model, recipe.groups(), recipe.steps),
        strategies=(EmptySpace(batches, emptied), RefineGrid(voxels)),
        steps=recipe.steps,
        regularizers=_terms(recipe, [name for name, _ in model.named_parameters()], emptied[0]),
    )


def _terms(recipe: "TensorfRecipe", names: list[str], emptied: int) -> dict[str, Regularizer]:
    """What is added to the loss, by name."""
    from ringlight.methods.tensorf import LAST_RATE

    terms: dict[str, Regularizer] = {}
    if any(recipe.l1_weights):
        density = [name for name in names if name.startswith("field.density_factors.")]
        terms["l1"] = FactorSize(density, *recipe.l1_weights, until=emptied)
    for of, weight in (("density", recipe.tv_density), ("appearance", recipe.tv_appearance)):
        if weight:
            planes = [name for name in names if name.startswith(f"field.{of}_factors.planes.")]
            terms[f"{of} variation"] = FactorVariation(planes, weight, recipe.steps, LAST_RATE)
    return terms


def refuse_too_large(recipe: "TensorfRecipe", box: torch.Tensor) -> None:
    """Raise RecipeError, with the largest side that fits, for a grid whose training memory cannot hold."""
    memory = int(SHARE * machine_memory())

    def bytes_of(side: int) -> int:
        x, y, z = sides_of(box, side**3)
        nodes = x + y + z + (x * y + x * z + y * z if recipe.decomposition == "vm" else 0)
        return 4 * COPIES * sum(recipe.components) * nodes

    if bytes_of(recipe.final_side) <= memory:
        return
    fits = next((side for side in range(recipe.final_side, 1, -1) if bytes_of(side) <= memory), 2)
    raise RecipeError(
        f"a grid of {recipe.final_side} cubed takes {bytes_of(recipe.final_side) / MEGABYTE:,.0f} MB while it trains, "
        f"and {SHARE:.0%} of this machine's memory is {memory / MEGABYTE:,.0f} MB; give --last-side {fits} or less"
    )
