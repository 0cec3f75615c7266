"""What to tell someone who brings photographs or a film without cameras: the commands that find them."""

import shlex
from pathlib import Path

PHOTOGRAPHS = frozenset([".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp"])
FILMS = frozenset([".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts"])
"""Suffixes, in lower case, of what COLMAP and ffmpeg read in any build."""

FRAMES_PER_SECOND = 2
"""Of a film, as photographs: neighbours overlap, and a minute gives 120."""

USUAL_FOLDERS = ("", "images", "input", "photos", "rgb")
"""Where photographs lie below a scene's folder."""


def remedy_without_cameras(path: Path) -> str | None:
    """Commands for the photographs in a folder, or for a film; None where ``path`` is neither.

    Raises OSError for a folder that cannot be read.
    """
    if path.is_file():
        return _of_film(path) if path.suffix.lower() in FILMS else None
    for name in USUAL_FOLDERS:
        photographs = path / name
        count = sum(file.suffix.lower() in PHOTOGRAPHS for file in photographs.iterdir()) if photographs.is_dir() else 0
        if count:
            noun = "photograph" if count == 1 else "photographs"
            return f"it holds {count} {noun} without cameras; find these with COLMAP: {_colmap(photographs)}"
    film = next((file for file in sorted(path.iterdir()) if file.suffix.lower() in FILMS), None)
    return None if film is None else _of_film(film)


def _of_film(film: Path) -> str:
    photographs = film.with_name(f"{film.stem}-photographs")
    cut = f"ffmpeg -i {_quoted(film)} -vf fps={FRAMES_PER_SECOND} -qscale:v 2 {_quoted(photographs / '%04d.jpg')}"
    return (
        f"{film.name} is a film; make photographs of it and find their cameras: "
        f"mkdir -p {_quoted(photographs)} && {cut} && {_colmap(photographs)}"
    )


def _colmap(photographs: Path) -> str:
    """From photographs to a scene beside them, with lenses undistorted."""
    beside = photographs.resolve()
    found, scene = beside.with_name(f"{beside.name}-colmap"), beside.with_name(f"{beside.name}-scene")
    here = _quoted(photographs)
    return (
        f"mkdir -p {_quoted(found)} {_quoted(scene)} && "
        f"colmap automatic_reconstructor --workspace_path {_quoted(found)} --image_path {here} --dense 0 && "
        f"colmap image_undistorter --image_path {here} --input_path {_quoted(found / 'sparse' / '0')} "
        f"--output_path {_quoted(scene)}; then train on {_quoted(scene)}"
    )


def _quoted(path: Path) -> str:
    return shlex.quote(str(path))
