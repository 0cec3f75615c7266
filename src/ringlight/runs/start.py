"""A new training run: everything that can be wrong with it is found before its folder is made."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import ringlight
from ringlight.core.scene import Scene
from ringlight.data.decode_check import DecodeCheck
from ringlight.data.load import kept_options, load_scene, with_absent_masks_left_out
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.measure.peak_memory import PeakMemory
from ringlight.methods.recipe import Recipe
from ringlight.rasterize.choose import refuse_without_gpu
from ringlight.runs.clock import Clock
from ringlight.runs.folder import RunFolder, make_free_folder, refuse_taken
from ringlight.runs.limits import PreparedRun, prepare_run
from ringlight.runs.lock import RunLock
from ringlight.runs.record import LARGEST_SEED, RunRecord
from ringlight.runs.session import Session
from ringlight.runs.starting_points import with_points_of
from ringlight.runs.undistorted import UndistortedFolder
from ringlight.runs.warm_start import read_start

Loaded = Callable[[str, Scene], None]
"""Called with the method's name and the scene that was read."""


def nobody(preset: str, scene: Scene) -> None:
    """Hears of a scene, and says nothing."""


def unchanged(run: PreparedRun) -> None:
    """Leaves what was prepared as it is."""


def start_run(
    out: Path,
    scene_path: Path,
    preset: str,
    recipe: Recipe,
    options: SceneOptions,
    seed: int,
    device: str,
    model: Path | None = None,
    loaded: Loaded = nobody,
    prepared: Callable[[PreparedRun], None] = unchanged,
    numbered: bool = False,
) -> Session:
    """A new run, from a ``model`` or PLY if one is named; its checkpoint of step 0 then holds what it starts from.

    ``loaded`` hears of the scene before anything is tried on it, which may take long; ``prepared`` may change a
    training before its first step. A folder ``out`` that holds anything is refused at once; ``numbered`` takes the
    first number behind its name that is free once the folder is made. Raises RecipeError, BackendError, SceneError,
    ModelFileError or RunError, with nothing written.
    """
    if recipe.steps < 1:
        raise RecipeError(f"--steps is {recipe.steps}; give at least 1")
    if not 0 <= seed <= LARGEST_SEED:
        raise RecipeError(f"--seed is {seed}; give a whole number from 0 to {LARGEST_SEED}")
    if not numbered:
        refuse_taken(out)
    memory = PeakMemory()
    refuse_without_gpu(device)  # before photographs are read, which takes long
    options = kept_options(scene_path, with_points_of(recipe, options))
    start = None if model is None else read_start(model)
    undistorted = UndistortedFolder()
    scene = load_scene(scene_path, options, undistorted)
    loaded(preset, scene)
    photographs = DecodeCheck(scene)
    run = prepare_run(scene, recipe, seed, device, start)
    prepared(run)
    photographs.refuse_damaged()
    options = with_absent_masks_left_out(options, scene)
    record = RunRecord(preset, run.recipe, scene_path.resolve(), options, seed, device, ringlight.__version__)
    if model is not None:
        record = replace(record, start=str(model.resolve()))
    record.to_json()  # what it refuses leaves no folder
    folder = RunFolder(make_free_folder(out)) if numbered else RunFolder.create(out)
    lock = RunLock(folder.path)
    record.write(folder.path)
    undistorted.begin(folder.undistorted)
    clock = Clock(choosing=run.choosing + photographs.cpu_seconds)
    session = Session(
        folder, record, run.scene, run.training, clock, lock, memory, photographs, run.warnings, run.decided
    )
    if model is not None:
        session.save()
    return session
