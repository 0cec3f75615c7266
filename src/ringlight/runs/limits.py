"""The most Gaussians, or whatever a model grows, that this machine has memory for.

It is decided once, when a run starts, and written into its record. Numbers depend on it only where the recipe's own
bound, by default a Gaussian for each pixel of a photograph, would not fit; a resumed run keeps what it started with, on
whatever machine.
"""

import time
from dataclasses import dataclass, replace

import torch

from ringlight.core.scene import Scene
from ringlight.fit.room import SHARE, most_rows
from ringlight.fit.train import Training
from ringlight.methods.recipe import Recipe
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.warm_start import Start, begin_with, going_on, settled_like


@dataclass(frozen=True)
class PreparedRun:
    """What will run: a recipe that leaves nothing to the scene or to this machine, and the training it builds."""

    recipe: Recipe
    scene: Scene
    training: Training
    decided: str | None
    """What the recipe left to the scene, in a sentence."""
    choosing: float
    """CPU seconds before the first step: a trial trains, too, and a hull is carved."""
    warnings: tuple[str, ...]
    """A sentence on each thing that memory did not allow, or that the back end does otherwise."""


def prepare_run(scene: Scene, recipe: Recipe, seed: int, device: str, start: Start | None = None) -> PreparedRun:
    """A new run, within this machine's memory; from ``start``, if there is one, instead of the scene's points."""
    begun = time.process_time()
    if start is not None:
        recipe = going_on(settled_like(recipe, start), start)
    recipe, decided = recipe.settled(scene, rasterizer_for(device), seed)
    if start is not None:
        recipe = going_on(recipe, start)  # of the method that it has settled on
    training = recipe.build(scene, rasterizer_for(device), seed)
    most = most_rows(training.model, guarded=training.guard is not None)
    recipe, scene, warnings = bounded(recipe, scene, training, most)
    if warnings:
        training = recipe.build(scene, rasterizer_for(device), seed)
    if start is not None:
        begin_with(training, recipe, scene, start)
    choosing, note = time.process_time() - begun, training.model.note
    return PreparedRun(recipe, scene, training, decided, choosing, (*warnings, note) if note else warnings)


def bounded(recipe: Recipe, scene: Scene, training: Training, most: int) -> tuple[Recipe, Scene, tuple[str, ...]]:
    """Recipe and scene of a run with no more than ``most`` Gaussians, and a sentence on each thing that was changed.

    A bound that the user stated is obeyed as it is: who gives --densify.max-gaussians knows better. What does not grow
    is left alone; what grows without a bound fails once memory is short.
    """
    grown = [strategy.most for strategy in training.strategies if strategy.most is not None]
    if not grown:
        return recipe, scene, ()
    notes: list[str] = []
    remedy = f"that is what {SHARE:.0%} of this machine's memory holds; --densify.max-gaussians sets another bound"
    if max(grown) > most and recipe.most is None:
        recipe = recipe.never_above(most)
        notes.append(f"at most {most:,} {training.model.counted().noun} instead of {max(grown):,}: {remedy}")
    start = len(scene.points.positions)
    allowed = max(most, recipe.most or 0)
    if start > allowed:
        rows = torch.arange(allowed) * start // allowed  # evenly through the file, whatever its order
        kept_points = replace(
            scene.points,
            positions=scene.points.positions[rows],
            colors=scene.points.colors[rows],
            normals=None if scene.points.normals is None else scene.points.normals[rows],
        )
        scene = replace(scene, points=kept_points)
        notes.append(f"{allowed:,} of the {start:,} points are used to start with: {remedy}")
    return recipe, scene, tuple(notes)
