"""Scenes that come with the program: small, procedural, path traced, ours to ship (README.md beside this file)."""

from difflib import get_close_matches
from pathlib import Path

from ringlight.errors import SceneError

FOLDER = Path(__file__).resolve().parent

BUNDLED = ("toaster", "carpaint")
"""Names of the bundled scenes: chrome, clear coat. 50 training and 10 test views of 200x200 each."""


def scene_folder(path: Path) -> Path:
    """``path``, or the bundled scene of that name where there is no such folder.

    Raises SceneError for a name that is nearly a bundled one's and no folder's, else as :func:`bundled_scene`.
    """
    if path.exists():
        return path
    if str(path) in BUNDLED:
        return bundled_scene(str(path))
    near = get_close_matches(path.name, BUNDLED, n=1)
    if near and str(path) == path.name:
        raise SceneError(f"{path}: no such folder; perhaps you meant the bundled scene {near[0]!r}")
    return path


def bundled_scene(name: str) -> Path:
    """The folder of a bundled scene, in the layout of NeRF-Synthetic.

    Raises SceneError for a name that is not bundled, or where the installation lacks the scene's files.
    """
    if name not in BUNDLED:
        near = get_close_matches(name, BUNDLED, n=1)
        hint = f"perhaps you meant {near[0]!r}" if near else f"bundled scenes: {', '.join(BUNDLED)}"
        raise SceneError(f"no bundled scene is called {name!r}; {hint}")
    folder = FOLDER / name
    if not folder.is_dir():
        raise SceneError(f"{folder}: the bundled scene {name!r} is not installed; install ringlight again")
    return folder
