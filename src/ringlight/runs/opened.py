"""A trained model with what is known around it: from a model file, or from a whole run folder."""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ringlight.core.command_line import command
from ringlight.core.scene import Scene
from ringlight.data.bundled import BUNDLED, scene_folder
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RunError
from ringlight.files.model_file import SceneFacts
from ringlight.measure.report import folders_with
from ringlight.methods.recipe import recipe_from_dict
from ringlight.methods.store import StoredModel, load_model
from ringlight.rasterize.choose import host_rasterizer, rasterizer_for
from ringlight.runs.folder import MODEL_NAME, RunFolder
from ringlight.runs.imported import PLY
from ringlight.runs.record import RECORD_NAME, RunRecord
from ringlight.runs.undistorted import UndistortedFolder


@dataclass(frozen=True)
class Opened:
    """``file`` is the model file; ``run`` the folder it belongs to, None for a model file on its own."""

    file: Path
    run: RunFolder | None
    stored: StoredModel


def find_model(path: Path) -> tuple[Path, RunFolder | None]:
    """The model file that ``path`` names, and the run folder if it is one. Raises RunError for another folder, or where
    nothing is."""
    if not path.exists():
        train = f"{path} is a bundled scene, train it first: {command('train', path, 'ringlight')}"
        raise RunError(
            f"{path}: no run and no model file is there; {train if str(path) in BUNDLED else 'check the path'}"
        )
    if not path.is_dir():
        return path, None
    folder = RunFolder(path)
    if folder.model.is_file():
        return folder.model, folder
    if (path / RECORD_NAME).is_file():
        raise RunError(f"{path}: holds no model yet; go on with: {command('train', '--resume', path)}")
    if inside := folders_with(MODEL_NAME, path):
        raise RunError(f"{path}: is no run itself; name a run inside it: {inside}")
    raise RunError(f"{path}: holds no {MODEL_NAME}; give a folder or a model file that 'ringlight train' wrote")


def open_model(path: Path, device: str | None = None) -> Opened:
    """The model in a file or run folder, ready to render; without a ``device`` on the CPU.

    Raises ModelFileError, RunError or BackendError.
    """
    file, run = find_model(path)
    return Opened(file, run, load_model(file, rasterizer_for(device) if device else host_rasterizer()))


def scene_of(opened: Opened, asked: Path | None, options: SceneOptions, again: str = "") -> Scene:
    """The scene at ``asked``, a folder or a bundled one's name, or without it the one that the model was trained on,
    read as it was read then.

    ``again`` is the command that names the folder, for a refusal where none is ``asked``. A model knows its background:
    black stays black unless ``options`` say otherwise. Raises RecipeError for ``options`` without ``asked``, RunError
    if there is no scene to go by, SceneError if it cannot be read.
    """
    if asked is not None:
        if options.background == "auto" and opened.stored.header.scene.background == "black":
            options = replace(options, background="black")
        return load_scene(scene_folder(asked), options)
    named = opened.file if opened.run is None else opened.run.path
    if options != SceneOptions():
        raise RecipeError(f"{named}: its scene is read as in training; to read it otherwise name its folder: {again}")
    place, recorded = recorded_scene(opened)
    if opened.stored.header.step == 0 and place.suffix.lower() == PLY:
        raise RunError(f"{named}: was imported from a PLY, which has no photographs; name their folder: {again}")
    if not place.is_dir():
        record = "" if opened.run is None else f', correct "scene" in {opened.run.path / RECORD_NAME}'
        remedy = f"put it back{record}, or name the folder where it is now: {again}"
        raise RunError(f"{place}: the scene of {named} is gone; {remedy}")
    keeper = None if opened.run is None else UndistortedFolder(opened.run.undistorted)
    return load_scene(place, recorded, keeper)


def with_cameras_of(opened: Opened, folder: Path) -> Opened:
    """The same model, with the training cameras of the scene in ``folder``. Raises SceneError."""
    scene = scene_of(opened, folder, SceneOptions())
    stored = replace(opened.stored, cameras=tuple(view.camera for view in scene.train))
    return replace(opened, stored=stored)


def recorded_scene(opened: Opened) -> tuple[Path, SceneOptions]:
    """Where the scene was that the model was trained on, and how it was read: from the run's record, or from the model
    file. Raises RunError for a damaged record, RecipeError for a damaged file."""
    if opened.run is not None:
        record = RunRecord.read(opened.run.path)
        return record.scene, record.options
    facts = opened.stored.header.scene
    return Path(facts.source), recipe_from_dict(SceneOptions, facts.options, f"{opened.file}: options")


def scene_facts_of(opened: Opened) -> SceneFacts:
    """What the model's file says of its scene, with the place and the options of the run, which a file made of it
    leaves."""
    facts = opened.stored.header.scene
    with suppress(RunError, RecipeError):
        place, options = recorded_scene(opened)
        facts = replace(facts, source=str(place), options=asdict(options))
    return facts
