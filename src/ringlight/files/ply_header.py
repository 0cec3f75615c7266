"""The header of a binary PLY file: where the vertex table lies and what its rows look like.

Format: G. Turk, "The PLY Polygon File Format" (1994); rows of numbers are read, lists are not.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ringlight.core.lost_disk import what_helps
from ringlight.core.words import counted
from ringlight.data.ply_points import TYPES
from ringlight.errors import ModelFileError

LARGEST_HEADER = 1 << 16
"""Bytes searched for the end of the header; a 3DGS header has about 1,500."""

REMEDY = "copy it again from where it was made, or export it again"


@dataclass(frozen=True)
class PlyTable:
    """The element ``vertex``: rows of ``dtype`` from byte ``begin`` of the file."""

    dtype: np.dtype
    rows: int
    begin: int
    comments: tuple[str, ...]


@dataclass
class _Element:
    name: str
    rows: int
    columns: list[tuple[str, str]]
    has_list: bool = False

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.columns)


def read_ply_header(path: Path) -> PlyTable:
    """The vertex table, which is known to lie inside the file. Raises ModelFileError."""
    start, size = _start_of(path)
    lines, begin = _header_lines(path, start, size)
    _check_encoding(path, lines)
    elements = _elements(path, lines)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise ModelFileError(f"{path}: the PLY has no vertices, so it is not a 3-D Gaussian model; name another file")
    index = names.index("vertex")
    if any(element.has_list for element in elements[: index + 1]):
        raise ModelFileError(
            f"{path}: the PLY holds lists, so it is a mesh and not a 3-D Gaussian model; name another file"
        )
    vertex = elements[index]
    begin += sum(element.rows * element.dtype.itemsize for element in elements[:index])
    end = begin + vertex.rows * vertex.dtype.itemsize
    if end > size:
        raise ModelFileError(
            f"{path}: the file is cut short or its number of vertices, {vertex.rows}, is wrong: they need "
            f"{counted(end, 'byte')}, the file has {size:,}; {REMEDY}"
        )
    if end < size and index == len(elements) - 1:
        raise ModelFileError(
            f"{path}: the file is damaged: {counted(size - end, 'byte')} too many behind the last vertex; {REMEDY}"
        )
    comments = tuple(line[8:] for line in lines if line.startswith("comment "))
    return PlyTable(vertex.dtype, vertex.rows, begin, comments)


def _start_of(path: Path) -> tuple[bytes, int]:
    """The first bytes of the file, and its size."""
    try:
        with path.open("rb") as file:
            return file.read(LARGEST_HEADER), file.seek(0, 2)
    except FileNotFoundError as error:
        raise ModelFileError(f"{path}: there is no such file; check the path") from error
    except OSError as error:
        check = what_helps(error, "check the path and its permissions")
        raise ModelFileError(f"{path}: cannot be opened: {error.strerror}; {check}") from error


def _header_lines(path: Path, start: bytes, size: int) -> tuple[list[str], int]:
    """The lines between the first and the last of the header, and the first byte after it."""
    if size == 0:
        raise ModelFileError(f"{path}: the file is empty; {REMEDY}")
    if not re.match(rb"ply\r?\n", start) and not b"ply\n".startswith(start):
        raise ModelFileError(f"{path}: is not a PLY file (it does not begin with 'ply'); name another file")
    last = re.search(rb"\nend_header\r?\n", start)
    if last is None:
        raise ModelFileError(f"{path}: the file is cut short inside its header, or the header is damaged; {REMEDY}")
    text = start[: last.start()].decode("latin-1")
    return [line.rstrip("\r") for line in text.split("\n")[1:]], last.end()


def _check_encoding(path: Path, lines: list[str]) -> None:
    if "format binary_little_endian 1.0" in lines:
        return
    found = next((line for line in lines if line.startswith("format ")), "no format line")
    raise ModelFileError(
        f"{path}: only binary little-endian PLY files are read, this one says {found[:60]!r}; "
        "save it again as binary little-endian with the program that made it"
    )


def _elements(path: Path, lines: list[str]) -> list[_Element]:
    elements: list[_Element] = []
    for line in lines:
        words = line.split()
        if not words or words[0] in ("format", "comment", "obj_info"):
            continue
        if words[0] == "element" and len(words) == 3 and re.fullmatch("[0-9]{1,18}", words[2]):
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[0] == "property" and elements and words[1:2] == ["list"]:
            elements[-1].has_list = True
        elif words[0] == "property" and elements and len(words) == 3 and words[1] in TYPES:
            elements[-1].columns.append((words[2], "<" + TYPES[words[1]]))
        else:
            raise ModelFileError(f"{path}: the header is damaged at {line[:60]!r}; {REMEDY}")
    for element in elements:
        names = [name for name, _ in element.columns]
        if len(set(names)) < len(names) or not (names or element.has_list):
            raise ModelFileError(f"{path}: the columns of {element.name[:60]!r} in the header are damaged; {REMEDY}")
    return elements
