"""The files of a scene's folder: read whole, found by the name another file gives, which cannot lead out of the folder.

A link in the folder may: no file of a scene can place one, and photographs in caches and under git-annex or DVC are
links.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from ringlight.core.lost_disk import what_helps
from ringlight.core.words import counted
from ringlight.errors import SceneError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".tif", ".tiff", ".heic", ".HEIC", ".avif")
"""Tried in this order where a name comes without its suffix, or with that of the full-size image."""


LONGEST_NAME = 255
"""Characters that a file's name may have, on most file systems."""

MOST_SHOWN = 60
"""Characters shown of a longer one."""


def read_bytes(path: Path) -> bytes:
    """The whole file.

    Raises:
        SceneError: the file is missing or may not be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise SceneError(
            f"{path}: cannot be read ({reason}); {what_helps(error, 'restore the file or its permissions')}"
        ) from error


def image_inside(base: Path, name: str, where: str) -> Path | None:
    """As :func:`file_inside`, for a name that may lack its suffix (NeRF-Synthetic) or have that of another size."""
    candidates = [name, *(name + suffix for suffix in IMAGE_SUFFIXES)]
    stem, dot, suffix = name.rpartition(".")
    if dot + suffix.lower() in IMAGE_SUFFIXES:
        candidates += [stem + suffix for suffix in IMAGE_SUFFIXES]
    return next((path for candidate in candidates if (path := file_inside(base, candidate, where))), None)


def file_inside(base: Path, name: str, where: str) -> Path | None:
    """The file, or link to one, called ``name`` below ``base``; None where there is no such file.

    Backslashes separate folders too, as on the machine where the name was written; ``where`` says who named it.

    Raises:
        SceneError: the name leaves ``base``, no file can have it, or it is of a link that leads nowhere.
    """
    try:
        root = base.resolve()
        path = Path(os.path.normpath(root / name.replace("\\", "/")))
        path.resolve()  # raises for what no file can be called
        if path.is_relative_to(root):
            if path.is_symlink() and not path.exists():
                target = path.readlink()
                raise SceneError(
                    f"{where} names the file {shown(name)}, a link to {shown(str(target))}, which is gone; fetch it"
                )
            return path if path.is_file() else None
    except (OSError, ValueError, RuntimeError) as error:  # too long, with a NUL, not unicode; a ring of links
        raise SceneError(
            f"{where} names the file {shown(name)}, which no file can be called; correct the name"
        ) from error
    raise SceneError(f"{where} names the file {shown(name)} outside {base}; move the file into that folder")


def shown(name: str) -> str:
    """A name from a file, for a sentence: as Python writes it, and its beginning where no file could be called so."""
    return repr(name) if len(name) <= LONGEST_NAME else f"{name[:MOST_SHOWN]!r}... ({len(name)} characters)"


def require_none_missing(missing: Sequence[tuple[str, str]], total: int, base: Path) -> None:
    """Raise a SceneError about the first of the ``(where, name)`` in ``missing`` and their number, if there are any."""
    if not missing:
        return
    where, name = missing[0]
    raise SceneError(
        f"{where} names the image {shown(name)}, which does not exist below {base} ({len(missing)} of "
        f"{counted(total, 'image')} missing); copy the missing images there, or remove their entries"
    )
