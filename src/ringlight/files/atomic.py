"""All or nothing: a file appears under its name complete, or the old one stays."""

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import BinaryIO

from ringlight.core.lost_disk import what_helps
from ringlight.errors import OutputError

REMEDIES = {
    errno.ENOSPC: "no space is left on the disk; free some or choose another folder",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another folder",
    errno.EFBIG: "the file would exceed the largest size allowed here; raise that limit or choose another folder",
    errno.EACCES: "permission is denied; choose a folder you may read and write",
    errno.EPERM: "permission is denied; choose a folder you may read and write",
    errno.EROFS: "the disk is read-only; choose another folder",
    errno.ENOENT: "its folder does not exist; create it first",
    errno.ENOTDIR: "part of its path is a file, not a folder; choose another path",
    errno.ENAMETOOLONG: "its name is too long for this disk; choose a shorter one",
}
"""What the user can do about the usual failures, by error number."""

NOT_FLUSHED = frozenset([errno.EINVAL, errno.ENOTSUP])
"""What file systems say whose folders know no flushing; they keep names in their own way."""

BEGUN, HALF_DONE = ".ringlight-", ".part"
"""How temporary names begin and end."""


@contextmanager
def written_atomically(path: Path, flushed: bool = True) -> Iterator[BinaryIO]:
    """A file to write and seek in, which takes the name ``path`` only when the block has ended well.

    The bytes go to a temporary name in the same folder (a rename never crosses disks), and both the file and
    the folder are ``flushed`` to the disk. After any failure, an interrupt included, the temporary file is gone and
    an old file under ``path`` is as it was; unless the disk fails at the very last, when it is to keep the new name. A
    symbolic link is followed. Raises OutputError.
    """
    target = Path(os.path.realpath(path))
    try:
        _refuse_what_is_no_file(path, target)
        temporary = _temporary(target)
        with flushed_names(target.parent) if flushed else nullcontext():
            try:
                with temporary.open("xb") as file:
                    yield file
                    if flushed:
                        file.flush()
                        os.fsync(file.fileno())
                temporary.replace(target)
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {_reason(error, target.parent)}") from error


def _reason(error: OSError, folder: Path) -> str:
    """Why no file was written in the folder, and what the user can do."""
    if error.errno == errno.ENOENT and folder.is_dir():  # as /proc refuses
        return "its folder takes no new files; choose another folder"
    choose = what_helps(error, "choose another path")
    return REMEDIES.get(error.errno or 0, f"{error.strerror or error}; {choose}")


def write_text(path: Path, text: str) -> None:
    """A UTF-8 text file, all or nothing. Raises OutputError."""
    with written_atomically(path) as file:
        file.write(text.encode())


def refuse_existing(path: Path, overwrite: bool) -> None:
    """Raises OutputError for a file that exists and may not be replaced, or whose folder does not exist or takes no
    files, which is tried; for those who work long before they write."""
    target = Path(os.path.realpath(path))
    try:
        if path.exists() and not overwrite:
            raise OutputError(f"{path}: exists already; give another name, or --overwrite to replace it")
        _refuse_what_is_no_file(path, target)
        trial = _temporary(target)
        with flushed_names(target.parent):
            trial.touch(exist_ok=False)
            trial.unlink()
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {_reason(error, target.parent)}") from error


def _temporary(target: Path) -> Path:
    return target.with_name(f"{BEGUN}{secrets.token_hex(6)}{HALF_DONE}")


def _refuse_what_is_no_file(path: Path, target: Path) -> None:
    """A rename would replace a device by a file, and fails over a folder after all the work is done. Raises OSError for
    a name that no file can have, or of which the disk says nothing."""
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: cannot be written: it is a folder; name a file inside it")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: cannot be written: it is not a regular file; name a file")


def sweep(folder: Path) -> None:
    """Remove what killed writers left half done; nobody may be writing into the folder meanwhile."""
    for path in folder.glob(f"{BEGUN}*{HALF_DONE}"):
        with suppress(OSError):  # somebody else's, on a disk that may only be read: no obstacle
            path.unlink()


@contextmanager
def flushed_names(folder: Path) -> Iterator[None]:
    """Make renames in the block survive a power cut. Raises OSError before it where the folder cannot be opened, which
    takes the right to read it; Windows cannot open folders and needs no such call."""
    if os.name == "nt":
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        yield
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in NOT_FLUSHED:
                raise
    finally:
        os.close(handle)
