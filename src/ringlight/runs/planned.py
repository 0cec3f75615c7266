"""A run of many: in its own folder of the usual kind, made where it is missing, kept where it is finished."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from ringlight.data.bundled import BUNDLED, scene_folder
from ringlight.data.load import kept_options, load_scene, with_absent_masks_left_out
from ringlight.data.options import FOUND, UNUSED, SceneOptions
from ringlight.errors import RunError
from ringlight.measure.report import REPORT_NAME, Report, read_report
from ringlight.methods.recipe import Recipe, recipe_from_dict, recipe_to_dict
from ringlight.methods.table import METHODS
from ringlight.runs.folder import RunFolder
from ringlight.runs.record import RECORD_NAME, RunRecord
from ringlight.runs.resume import resume_run
from ringlight.runs.session import Session
from ringlight.runs.start import Loaded, nobody, start_run
from ringlight.runs.starting_points import with_points_of

State = Literal["finished", "started", "to do"]


@dataclass(frozen=True)
class PlannedRun:
    """What ``ringlight train SCENE PRESET --seed SEED --out FOLDER`` would make, with this recipe."""

    scene: Path
    preset: str
    recipe: Recipe
    seed: int
    folder: Path
    options: SceneOptions

    @property
    def report(self) -> Report | None:
        """The report of the finished run; None before that. ``eval`` measures runs that were stopped, too."""
        if not (self.folder / REPORT_NAME).is_file():
            return None
        report = read_report(self.folder)
        return report if report.iterations == self.recipe.steps else None

    @property
    def state(self) -> State:
        """What is there already."""
        if self.report is not None:
            return "finished"
        return "started" if RunFolder(self.folder).recorded else "to do"

    def refuse_other(self) -> None:
        """Raises RunError where the folder holds a run of other settings, which would be taken for this one, SceneError
        where only the scene could tell and cannot be read."""
        if not (self.folder / RECORD_NAME).is_file():
            return
        record = RunRecord.read(self.folder)
        same = (record.seed, record.scene) == (self.seed, self.scene.resolve())
        if not (same and self.recipe.may_settle_on(record.recipe) and self._reads_as(record.options)):
            raise RunError(f"{self.folder}: holds a run of other settings; give another folder with --out")
        if record.added:
            raise RunError(
                f"{self.folder}: holds a run that was extended to {record.steps} steps, and {self.recipe.steps} are "
                "asked for; give another folder with --out"
            )

    def _reads_as(self, kept: SceneOptions) -> bool:
        """Whether a run of this keeps these options. Only the scene tells whether there are masks to be found; raises
        SceneError where it cannot be read."""
        options = kept_options(self.scene, with_points_of(self.recipe, self.options))
        if kept.masks == UNUSED and replace(kept, masks=FOUND) == options:
            return kept == without_absent_masks(self.scene.resolve(), options)
        return kept == options

    def session(self, device: str = "auto", loaded: Loaded = nobody) -> Session:
        """The training, from its start or from where it stopped; ``loaded`` hears of the scene."""
        self.refuse_other()
        if RunFolder(self.folder).recorded:
            return resume_run(self.folder, loaded=loaded)
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        session = start_run(
            self.folder, self.scene, self.preset, self.recipe, self.options, self.seed, device, loaded=loaded
        )
        # From here on there is something to resume from, whatever happens.
        session.save()
        return session

    def to_plain(self) -> dict[str, Any]:
        """Plain values, ready for JSON; paths are full and a list of test images is its names, for a machine that
        shares the disk and stands in another folder. Raises SceneError for a list that cannot be read."""
        return {
            "scene": str(self.scene.resolve()),
            "preset": self.preset,
            "recipe": recipe_to_dict(self.recipe),
            "seed": self.seed,
            "folder": str(self.folder.resolve()),
            "options": asdict(kept_options(self.scene, self.options)),
        }

    @staticmethod
    def from_plain(values: Mapping[str, Any]) -> "PlannedRun":
        """The run that :meth:`to_plain` describes. Raises RecipeError for settings of another version, KeyError for
        none."""
        preset = str(values["preset"])
        return PlannedRun(
            Path(values["scene"]),
            preset,
            recipe_from_dict(type(METHODS[preset]), values["recipe"], preset),
            int(values["seed"]),
            Path(values["folder"]),
            recipe_from_dict(SceneOptions, values["options"], "options"),
        )


@cache
def without_absent_masks(scene: Path, options: SceneOptions) -> SceneOptions:
    """What a run on it keeps of these; the scene is read once for all runs of a process."""
    return with_absent_masks_left_out(options, load_scene(scene, options))


def scenes_named(paths: Sequence[Path]) -> dict[str, Path]:
    """The scenes' folders by their names, bundled ones too.

    Raises RunError for what is no folder, and for two scenes of one name.
    """
    found: dict[str, Path] = {}
    for path in paths:
        scene = scene_folder(path)
        if not scene.is_dir():
            bundled = " or ".join(BUNDLED)
            raise RunError(f"{path}: there is no such folder; give a folder of photographs, or {bundled}")
        name = scene.resolve().name
        if name in found:
            raise RunError(f"two scenes are called {name!r}; rename one of the folders, or study them one by one")
        found[name] = scene
    return found


def with_steps(recipe: Recipe, steps: int | None) -> Recipe:
    """The same of another length, unless ``steps`` is None."""
    return recipe if steps is None else replace(recipe, steps=steps)
