"""The files of a scene's folder: read whole, found by the name another file gives, which cannot lead out of the folder.

A link in the folder may: no file of a scene can place one, and photographs in caches and under git-annex or DVC are
links.
"""

import errno
import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ringlight.core.lost_disk import what_helps
from ringlight.core.words import counted
from ringlight.errors import SceneError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".tif", ".tiff", ".heic", ".HEIC", ".avif")
"""Tried in this order where a name comes without its suffix, or with that of the full-size image."""

REFUSED_NAMES = frozenset([errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL, errno.EILSEQ])
"""What a disk says of a name that none of its files can have; all else is no fault of the name."""

LONGEST_NAME = 255
"""Characters that a file's name may have, on most file systems."""

MOST_SHOWN = 60
"""Characters shown of a longer one."""


class NameTooLongError(SceneError):
    """A scene names a file by more characters than the disk takes."""


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
    candidates = [name + suffix for suffix in IMAGE_SUFFIXES]
    stem, dot, suffix = name.rpartition(".")
    if dot + suffix.lower() in IMAGE_SUFFIXES:
        candidates += [stem + suffix for suffix in IMAGE_SUFFIXES]
    return file_inside(base, name, where) or first_inside(base, candidates, where)


def first_inside(base: Path, candidates: Sequence[str], where: str) -> Path | None:
    """As :func:`file_inside`, the first that exists of names made of one that a file gives; no file has one that is too
    long."""
    for candidate in candidates:
        with suppress(NameTooLongError):
            path = file_inside(base, candidate, where)
            if path is not None:
                return path
    return None


def file_inside(base: Path, name: str, where: str) -> Path | None:
    """The file, or link to one, called ``name`` below ``base``; None where there is no such file.

    Backslashes separate folders too, as on the machine where the name was written; ``where`` says who named it.

    Raises:
        SceneError: the name leaves ``base``, no file can have it, or it is of a link that leads nowhere.
        OSError: the disk does not say whether there is such a file.
    """
    try:
        return _found(base, name, where)
    except OSError as error:
        if error.errno not in REFUSED_NAMES:
            raise
        kind = NameTooLongError if error.errno == errno.ENAMETOOLONG else SceneError
        raise kind(_no_name(name, where)) from error
    except (ValueError, RuntimeError) as error:  # with a NUL, not unicode; a ring of links
        raise SceneError(_no_name(name, where)) from error


def _no_name(name: str, where: str) -> str:
    return f"{where} names the file {shown(name)}, which no file can be called; correct the name"


def _found(base: Path, name: str, where: str) -> Path | None:
    root = base.resolve()
    path = Path(os.path.normpath(root / name.replace("\\", "/")))
    path.resolve()  # raises for what no file can be called
    if not path.is_relative_to(root):
        raise SceneError(f"{where} names the file {shown(name)} outside {base}; move the file into that folder")
    try:
        is_link = stat.S_ISLNK(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None
    if is_link and not path.exists():
        target = shown(str(path.readlink()))
        raise SceneError(f"{where} names the file {shown(name)}, a link to {target}, which is gone; fetch it")
    return path if path.is_file() else None


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
