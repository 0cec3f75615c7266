"""Arrays of an NPZ file, read in pieces: nothing that a stranger's file says runs code or asks for memory.

An NPZ file is a ZIP archive with a member ``NAME.npy`` for each array (NumPy's ``numpy.lib.format``). NumPy's own
reader makes a whole array of whatever the head says; here a head is held against the size of the archive first, and
whoever reads takes as many bytes as a view needs. Arrays of objects, which are pickled, have no type that is known
here.
"""

import ast
import math
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from ringlight.core.lost_disk import what_helps
from ringlight.errors import SceneError

MAGIC = b"\x93NUMPY"

LENGTHS = {1: "<H", 2: "<I", 3: "<I"}
"""How the head's length is written, by the format's version."""

LONGEST_HEAD = 4096
"""Bytes; that of an array of numbers has 118."""

TYPES = re.compile(r"[<>][iuf][1248]|[<>]U[1-9]\d{0,3}")
"""Numbers of several bytes and texts. Whatever else there is, objects among it, is another type than is asked for."""

MOST_INFLATED = 1032
"""Bytes that a byte of a deflated stream can become (zlib's technical details)."""

DAMAGED = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, OverflowError, RuntimeError, ValueError,
)  # fmt: skip
"""What the library raises for archives that are cut, damaged or locked; RuntimeError is also for unknown packings."""

REMEDY = "make it again with numpy.savez_compressed"


@runtime_checkable
class Stream(Protocol):
    """A member of the archive while it is read."""

    def read(self, count: int, /) -> bytes:
        """The next ``count`` bytes, fewer at the end."""
        ...


@dataclass(frozen=True)
class Array:
    """``type`` as NumPy writes it ("<i2"), ``shape``, and the stream of its bytes in C order."""

    type: str
    shape: tuple[int, ...]
    stream: Stream

    def read(self, count: int) -> bytes:
        """The next ``count`` bytes. Raises EOFError where there are fewer."""
        content = self.stream.read(count)
        if len(content) != count:
            raise EOFError("its data end early")
        return content

    def refuse_rest(self) -> None:
        """To be called behind the last byte: the archive's checksum is compared there. Raises ValueError."""
        if self.stream.read(1):
            raise ValueError("its data go on behind their end")


@contextmanager
def opened_npz(path: Path) -> Iterator[zipfile.ZipFile]:
    """The archive, to be read inside the block by :func:`opened_array`. Raises SceneError, also for what is raised
    inside the block of damage."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except OSError as error:
        reason = error.strerror or type(error).__name__
        helps = what_helps(error, "check the path and its permissions")
        raise SceneError(f"{path}: cannot be read ({reason}); {helps}") from None
    except DAMAGED as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SceneError(f"{path}: is no NPZ file, or is damaged ({reason[:LONGEST_REASON]}); {REMEDY}") from None


LONGEST_REASON = 200
"""Characters of the library's that a sentence repeats."""


@contextmanager
def opened_array(archive: zipfile.ZipFile, name: str) -> Iterator[Array]:
    """One array, to be read inside the block of :func:`opened_npz`. Raises ValueError and what DAMAGED names."""
    try:
        member = archive.getinfo(f"{name}.npy")
    except KeyError:
        raise ValueError(f"it holds no array {name!r}") from None
    _refuse_false_sizes(archive, member, name)
    with archive.open(member) as stream:
        kind, shape, head_bytes = _head(stream, name)
        stated = math.prod(shape) * _bytes_each(kind) + head_bytes
        if stated != member.file_size:
            raise ValueError(f"array {name!r} has {member.file_size} bytes where its head says {stated}")
        yield Array(kind, shape, stream)


def _refuse_false_sizes(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> None:
    most = {zipfile.ZIP_STORED: 1, zipfile.ZIP_DEFLATED: MOST_INFLATED}.get(member.compress_type)
    if most is None:
        raise ValueError(f"array {name!r} is compressed in another way than NumPy does")
    if member.compress_size > archive.start_dir or member.file_size > most * member.compress_size:
        raise ValueError(f"array {name!r} says it is larger than the file can hold")


def _head(stream: Stream, name: str) -> tuple[str, tuple[int, ...], int]:
    """Type and shape of the array behind it, and the bytes of the head."""
    first = stream.read(len(MAGIC) + 2)
    form = LENGTHS.get(first[-2]) if len(first) == len(MAGIC) + 2 and first.startswith(MAGIC) else None
    if form is None:
        raise ValueError(f"{name}.npy is no array of NumPy's")
    width = struct.calcsize(form)
    (length,) = struct.unpack(form, stream.read(width))
    if length > LONGEST_HEAD:
        raise ValueError(f"the head of array {name!r} has {length} bytes")
    said = _literal(stream.read(length).decode("latin-1"), name)
    if not isinstance(said, dict) or said.keys() != {"descr", "fortran_order", "shape"}:
        raise ValueError(f"the head of array {name!r} cannot be read")
    kind, shape = said["descr"], said["shape"]
    if not isinstance(kind, str) or not TYPES.fullmatch(kind):
        raise ValueError(f"array {name!r} is of a type that is not taken: {kind!r}")
    if not isinstance(shape, tuple) or any(type(side) is not int or side < 0 for side in shape):
        raise ValueError(f"the head of array {name!r} cannot be read")
    if said["fortran_order"] is not False:
        raise ValueError(f"array {name!r} is in Fortran's order: apply numpy.ascontiguousarray before it is saved")
    return kind, shape, len(first) + width + length


def _literal(text: str, name: str) -> object:
    """What the head says: Python's words for a dictionary of texts, numbers and truths."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the parser, on what a stranger wrote
            return ast.literal_eval(text.strip())
    except (SyntaxError, ValueError, TypeError, MemoryError, RecursionError):
        raise ValueError(f"the head of array {name!r} cannot be read") from None


TEXT_UNIT = 4
"""Bytes of a character of NumPy's texts, UTF-32."""


def _bytes_each(kind: str) -> int:
    number = int(kind[2:])
    return number * TEXT_UNIT if kind[1] == "U" else number


def texts(array: Array) -> list[str]:
    """All of an array [V] of texts. Raises ValueError for what is no text, and what DAMAGED names."""
    each = _bytes_each(array.type)
    content = array.read(math.prod(array.shape) * each)
    array.refuse_rest()
    coding = "utf-32-le" if array.type[0] == "<" else "utf-32-be"
    return [content[at : at + each].decode(coding).rstrip("\0") for at in range(0, len(content), each)]
