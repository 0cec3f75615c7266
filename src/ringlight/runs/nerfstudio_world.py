"""From the world in which nerfstudio trained back to that of a model's scene."""

from pathlib import Path

from ringlight.data import nerfstudio
from ringlight.data.bundled import scene_folder
from ringlight.data.load import format_of
from ringlight.data.options import SceneOptions
from ringlight.errors import RunError
from ringlight.files.nerfstudio_frame import FRAME_NAME, UNMOVED, Moved, frame_beside, moved_by
from ringlight.runs.opened import Opened, recorded_scene


def scene_was_moved(path: Path, opened: Opened, asked: Path | None, again: str) -> Moved:
    """How nerfstudio moved the model's scene before the camera path in ``path`` was made, by the file beside that;
    not at all without such a file.

    A scene in nerfstudio's own format says in its file what had been done to it before. ``asked`` is its folder,
    without it the one that the model was trained on, and ``again`` the command that names it. Raises SceneError for
    damaged files, RunError where there is no scene to go by.
    """
    moved = frame_beside(path)
    if moved is None:
        return UNMOVED
    folder, options = (scene_folder(asked), SceneOptions()) if asked is not None else recorded_scene(opened)
    if not folder.is_dir():
        raise RunError(
            f"{path.with_name(FRAME_NAME)}: brings cameras back into the world of a scene, and {folder} is none; name "
            f"its folder: {again}, or take the file away if the cameras are in the model's world"
        )
    if format_of(folder, options) != "nerfstudio":
        return moved
    return moved.after(moved_by(folder / nerfstudio.LOOKS_FOR, "applied_transform", "applied_scale"))
