"""What to tell someone who brings photographs or a film without cameras: the command that finds them."""

import shlex
from pathlib import Path

from ringlight.core.words import counted

PHOTOGRAPHS = frozenset([".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".heic", ".heif", ".avif"])
FILMS = frozenset([".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts"])
"""Suffixes, in lower case, of what Pillow and PyAV read, with their plugins."""

USUAL_FOLDERS = ("", "images", "input", "photos", "rgb")
"""Where photographs lie below a scene's folder."""


def remedy_without_cameras(path: Path) -> str | None:
    """The command for the photographs in a folder, or for a film; None where ``path`` is neither.

    Raises OSError for a folder that cannot be read.
    """
    if path.is_file():
        return _of_film(path) if path.suffix.lower() in FILMS else None
    for name in USUAL_FOLDERS:
        photographs = path / name
        count = sum(file.suffix.lower() in PHOTOGRAPHS for file in photographs.iterdir()) if photographs.is_dir() else 0
        if count:
            return (
                f"it holds {counted(count, 'photograph')} without cameras; find these with: {_and_train(photographs)}"
            )
    film = next((file for file in sorted(path.iterdir()) if file.suffix.lower() in FILMS), None)
    return None if film is None else _of_film(film)


def scene_beside(photographs: Path) -> Path:
    """Where the cameras of these photographs, or of this film, go by default."""
    beside = photographs.resolve()
    return beside.with_name(f"{beside.stem if photographs.is_file() else beside.name}-scene")


def poses_command(photographs: Path, scene: Path) -> str:
    """The command line that finds the cameras, quoted for a shell."""
    return f"ringlight poses {shlex.quote(str(photographs))} {shlex.quote(str(scene))}"


def _of_film(film: Path) -> str:
    return f"{film.name} is a film; find the cameras of its sharpest pictures with: {_and_train(film)}"


def _and_train(photographs: Path) -> str:
    scene = scene_beside(photographs)
    return f"{poses_command(photographs, scene)}; then train on {shlex.quote(str(scene))}, or give train --poses auto"
