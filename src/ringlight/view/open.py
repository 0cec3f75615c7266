"""Runs, model files or a scene folder, as the subject of a viewer."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ringlight.core.camera import Camera
from ringlight.core.scene import Scene, camera_extent
from ringlight.data.load import has_cameras, load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RinglightError
from ringlight.runs.folder import MODEL_NAME
from ringlight.runs.opened import Opened, recorded_scene, scene_of
from ringlight.runs.record import RECORD_NAME
from ringlight.view.on_disk import Following, OnDisk
from ringlight.view.standpoint import is_same_pose
from ringlight.view.subject import PHOTOGRAPH, Subject, subject


def is_scene(path: Path) -> bool:
    """Whether it is a folder of photographs with cameras, rather than a run."""
    is_run = (path / MODEL_NAME).is_file() or (path / RECORD_NAME).is_file()
    return not is_run and has_cameras(path)


@dataclass(frozen=True)
class Found:
    """What there is to see; the ``files`` of its models, by their names; a sentence on each thing that is missing."""

    subject: Subject
    files: Mapping[str, OnDisk]
    missing: list[str]


def open_subject(paths: Sequence[Path], asked: Path | None, device: str) -> Found:
    """What there is to see of ``paths``, one or more runs or model files of one scene, or one scene's folder.

    ``asked`` is the folder of the photographs, where it is not the models' own. Raises RecipeError for models of
    different scenes, and as the readers do.
    """
    if any(is_scene(path) for path in paths):
        if len(paths) > 1 or asked is not None:
            raise RecipeError("a scene's folder is looked at alone; name the photographs of runs by --scene FOLDER")
        alone = load_scene(paths[0])
        return Found(subject(alone.name, {}, [], alone, Path.cwd()), {}, [])
    files = {name: OnDisk(path, device) for name, path in named_apart(paths).items()}
    models = {name: file.opened for name, file in files.items()}
    first = next(iter(models.values()))
    for opened in models.values():
        _refuse_other_scene(first, opened, asked)
    missing: list[str] = []
    scene = _scene(first, asked, missing)
    cameras = next((opened.stored.cameras for opened in models.values() if opened.stored.cameras), ())
    if not cameras and scene is None:
        missing.append(f"{first.file}: holds no cameras; name the folder of photographs by --scene to see from theirs")
    shown = {name: (file.opened.stored.model, file.background) for name, file in files.items()}
    about = subject(Following(files).title, shown, cameras, scene, first.file.parent, paths[0])
    return Found(about, files, missing)


def named_apart(paths: Sequence[Path]) -> Mapping[str, Path]:
    """By their last names, numbered where these are the same, or that of the photographs."""
    named: dict[str, Path] = {}
    for path in paths:
        name = path.resolve().name
        number = 2
        while name in named or name == PHOTOGRAPH:
            name, number = f"{path.resolve().name} {number}", number + 1
        named[name] = path
    return named


def _refuse_other_scene(first: Opened, other: Opened, asked: Path | None) -> None:
    """Raise RecipeError unless the two show one scene: by the folder's name, or by the same cameras."""
    if first is other or asked is not None:
        return
    try:
        if recorded_scene(first)[0].resolve() == recorded_scene(other)[0].resolve():
            return
    except RinglightError:
        pass  # a damaged record: the cameras decide
    if not _same_cameras(first.stored.cameras, other.stored.cameras):
        raise RecipeError(
            f"{first.file} and {other.file} are of different scenes; look at runs of one scene together, and start "
            "another viewer, with another --port, for the others"
        )


def _same_cameras(ours: Sequence[Camera], theirs: Sequence[Camera]) -> bool:
    if not ours or len(ours) != len(theirs):
        return False
    extent = camera_extent(list(ours))
    return all(is_same_pose(one, other, extent) for one, other in zip(ours, theirs, strict=True))


def _scene(opened: Opened, asked: Path | None, missing: list[str]) -> Scene | None:
    """The photographs; None, and a sentence, where those of training are gone."""
    if asked is not None:
        return scene_of(opened, asked, SceneOptions())
    try:
        return scene_of(opened, None, SceneOptions(), "ringlight view … --scene FOLDER")
    except RinglightError as error:
        missing.append(f"no photographs are shown: {error}")
        return None
