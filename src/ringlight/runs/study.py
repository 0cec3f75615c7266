"""A study on disk: each run in its own folder of the usual kind, made where it is missing, kept where it is
finished."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from ringlight.core.gradients import COLUMNS
from ringlight.core.raw_bytes import FLOAT_BYTES, raw_bytes
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.measure.report import Report, read_report
from ringlight.methods.recipe import Recipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.variant import Variant
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.expected_time import Expected
from ringlight.runs.folder import RunFolder
from ringlight.runs.many import Order, Waiting
from ringlight.runs.method_runs import order_of
from ringlight.runs.planned import PlannedRun, State, scenes_named


@dataclass(frozen=True)
class StudyRun:
    """One run of a study: ``folder`` is FOLDER/SCENE/VARIANT/seed-SEED."""

    scene: Path
    variant: Variant
    seed: int
    folder: Path
    options: SceneOptions

    @property
    def planned(self) -> PlannedRun:
        """As any run of many, its size not yet bounded by another's."""
        return PlannedRun(self.scene, self.variant.preset, self.variant.recipe, self.seed, self.folder, self.options)

    @property
    def report(self) -> Report | None:
        """The report of the finished run; None before that."""
        return self.planned.report

    @property
    def state(self) -> State:
        """What is there already."""
        return self.planned.state

    def checked(self) -> "StudyRun":
        """Itself. Raises RunError where the folder holds a run of other settings, which would be taken for this one,
        SceneError where only the scene could tell and cannot be read."""
        self.planned.refuse_other()
        return self

    @property
    def expected(self) -> Expected:
        """What the time of missing runs is told by."""
        steps = self.variant.recipe.steps
        return Expected(
            str(self.scene), self.variant.name, self.variant.preset, steps, self.report, self.state != "finished"
        )

    @property
    def name(self) -> str:
        """SCENE/VARIANT/seed-SEED."""
        return self._named(self.variant.name)

    def order(self, threads: int, device: str, lpips: Sequence[str]) -> Order:
        """What does it is told this; where another variant's size bounds it, once that is measured."""

        def bounded() -> dict[str, Any]:
            planned = self.planned
            if not RunFolder(self.folder).recorded:
                planned = replace(planned, recipe=self._bounded_recipe())
            return order_of(planned, threads, device, lpips)

        other = self.variant.waits_for
        return bounded() if other is None else Waiting(self._named(other), bounded)

    @property
    def scene_name(self) -> str:
        """What rows call the scene: the name of its folder."""
        return self.folder.parents[1].name

    def _named(self, variant: str) -> str:
        return f"{self.scene_name}/{variant}/{self.folder.name}"

    def _bounded_recipe(self) -> Recipe:
        recipe, other = self.variant.recipe, self.variant.waits_for
        if other is None:
            return recipe
        measured = read_report(self.folder.parents[1] / other / self.folder.name)
        bound = self.variant.within
        most = measured.counted if bound is None else most_within(recipe, int(bound.share * measured.bytes_raw))
        return recipe.ending_with(most)


def runs_of_study(
    variants: Sequence[Variant], scenes: Sequence[Path], seeds: int, out: Path, options: SceneOptions
) -> tuple[StudyRun, ...]:
    """All runs, scene by scene and seed by seed, each variant after those whose size bounds it.

    Raises RunError for two scenes of one name, or a folder that holds a run of other settings, SceneError for a scene
    that cannot be read, RecipeError for options that leave no test views.
    """
    if options.holdout_every == 0 and options.holdout is None and not options.validate:
        raise RecipeError("a study compares on test views, and --holdout-every 0 leaves none; leave it out")
    found = scenes_named(scenes)
    present = {variant.name for variant in variants}
    for variant in variants:
        if variant.waits_for is not None and variant.waits_for not in present:
            raise RecipeError(f"{variant.name} is held to {variant.waits_for}, which --only leaves out; name both")
    ordered = sorted(variants, key=lambda variant: variant.waits_for is not None)
    return tuple(
        StudyRun(scene, variant, seed, out / name / variant.name / f"seed-{seed}", options).checked()
        for name, scene in found.items()
        for seed in range(seeds)
        for variant in ordered
    )


def most_within(recipe: SplatRecipe, size: int) -> int:
    """How many Gaussians a model of this recipe may have in ``size`` raw bytes.

    At least one, though what they share may take more.
    """
    empty = recipe.model(torch.tensor([[-1.0] * 3, [1.0] * 3]), rasterizer_for("reference")).rendering_tensors()
    shared = sum(map(raw_bytes, empty.values()))
    row = sum(FLOAT_BYTES * math.prod(tensor.shape[1:]) for name, tensor in empty.items() if name.startswith(COLUMNS))
    return max((size - shared) // row, 1)
