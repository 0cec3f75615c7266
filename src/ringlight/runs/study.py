"""A study on disk: each run in its own folder of the usual kind, made where it is missing, kept where it is
finished."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch

from ringlight.core.gradients import COLUMNS
from ringlight.core.raw_bytes import FLOAT_BYTES, raw_bytes
from ringlight.data.bundled import BUNDLED, scene_folder
from ringlight.data.load import kept_options
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RunError
from ringlight.measure.report import REPORT_NAME, Report, read_report
from ringlight.methods.recipe import Recipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.variant import Variant
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.folder import RunFolder
from ringlight.runs.record import RECORD_NAME, RunRecord
from ringlight.runs.resume import resume_run
from ringlight.runs.session import Session
from ringlight.runs.start import Loaded, nobody, start_run
from ringlight.runs.starting_points import with_points_of

State = Literal["finished", "started", "to do"]


@dataclass(frozen=True)
class StudyRun:
    """One run of a study: ``folder`` is FOLDER/SCENE/VARIANT/seed-SEED."""

    scene: Path
    variant: Variant
    seed: int
    folder: Path
    options: SceneOptions

    @property
    def report(self) -> Report | None:
        """The report of the finished run; None before that. ``eval`` measures runs that were stopped, too."""
        if not (self.folder / REPORT_NAME).is_file():
            return None
        report = read_report(self.folder)
        return report if report.iterations == self.variant.recipe.steps else None

    @property
    def state(self) -> State:
        """What is there already."""
        if self.report is not None:
            return "finished"
        return "started" if (self.folder / RECORD_NAME).is_file() else "to do"

    def checked(self) -> "StudyRun":
        """Itself. Raises RunError where the folder holds a run of other settings, which would be taken for this one."""
        if not (self.folder / RECORD_NAME).is_file():
            return self
        record = RunRecord.read(self.folder)
        options = kept_options(self.scene, with_points_of(self.variant.recipe, self.options))
        asked = (_comparable(self.variant.recipe), self.seed, self.scene.resolve(), options)
        if (_comparable(record.recipe), record.seed, record.scene, record.options) != asked:
            raise RunError(f"{self.folder}: holds a run of other settings; give another folder with --out")
        return self

    def session(self, device: str, loaded: Loaded = nobody) -> Session:
        """The training, from its start or from where it stopped; ``loaded`` hears of the scene.

        Raises RunError where it waits for another variant's size and that is not known.
        """
        self.checked()
        if RunFolder(self.folder).recorded:
            return resume_run(self.folder, loaded=loaded)
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        recipe = self._bounded_recipe()
        preset = self.variant.preset
        session = start_run(self.folder, self.scene, preset, recipe, self.options, self.seed, device, loaded=loaded)
        # From here on there is something to resume from, whatever happens.
        session.save()
        return session

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

    Raises RunError for two scenes of one name, or a folder that holds a run of other settings, RecipeError for options
    that leave no test views.
    """
    if options.holdout_every == 0 and options.holdout is None and not options.validate:
        raise RecipeError("a study compares on test views, and --holdout-every 0 leaves none; leave it out")
    found = [_scene(path) for path in scenes]
    names = [scene.resolve().name for scene in found]
    for name in names:
        if names.count(name) > 1:
            raise RunError(f"two scenes are called {name!r}; rename one of the folders, or study them one by one")
    present = {variant.name for variant in variants}
    for variant in variants:
        if variant.waits_for is not None and variant.waits_for not in present:
            raise RecipeError(f"{variant.name} is held to {variant.waits_for}, which --only leaves out; name both")
    ordered = sorted(variants, key=lambda variant: variant.waits_for is not None)
    return tuple(
        StudyRun(scene, variant, seed, out / name / variant.name / f"seed-{seed}", options).checked()
        for scene, name in zip(found, names, strict=True)
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


def _scene(path: Path) -> Path:
    """A folder of photographs, or the bundled scene of that name. Raises RunError for what is neither."""
    folder = scene_folder(path)
    if folder.is_dir():
        return folder
    raise RunError(f"{path}: there is no such folder; give a folder of photographs, or {' or '.join(BUNDLED)}")


def _comparable(recipe: Recipe) -> Recipe:
    """The recipe without the bound on Gaussians, which another run or this machine's memory may have set."""
    return recipe.ending_with(None)
