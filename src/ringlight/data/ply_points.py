"""Positions and colours of a point cloud in a PLY file (ascii or binary), such as nerfstudio's ``sparse_pc.ply``."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.scene import PointCloud
from ringlight.data.folder import read_bytes
from ringlight.data.poses import MAX_COORDINATE
from ringlight.errors import SceneError

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
"""PLY's names of scalar types, as numpy codes."""

BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

MAX_HEADER_BYTES = 65_536
"""Where the header must have ended; real ones take a few hundred bytes."""

COLOR_NAMES = ("red", "green", "blue")


@dataclass(frozen=True)
class Header:
    """What precedes the vertices: ``dtype`` of one vertex, their number, and the byte at which they start."""

    is_ascii: bool
    dtype: np.dtype
    count: int
    start: int


def read_ply_points(path: Path) -> PointCloud:
    """The vertices' x y z and, if present, red green blue (integers of any width, or floats in [0, 1]); else mid grey.

    Vertices whose position or colour is not finite, or whose position is beyond belief, are left out.

    Raises:
        SceneError: not a PLY file, one whose first element is not ``vertex`` with x y z, or one that is cut.
    """
    data = read_bytes(path)
    header = _read_header(data, path)
    columns = _ascii_columns(data, header, path) if header.is_ascii else _binary_columns(data, header, path)
    with np.errstate(invalid="ignore"):  # a signalling NaN says so when it is converted
        positions = np.stack([columns[axis] for axis in "xyz"], -1).astype(np.float64)
        colors = _colors(columns, header)
    usable = (np.abs(positions) <= MAX_COORDINATE).all(1) & np.isfinite(colors).all(1)  # NaN is neither
    colors = colors[usable].clip(0, 1).astype(np.float32)
    return PointCloud(torch.from_numpy(positions[usable].astype(np.float32)), torch.from_numpy(colors))


def _read_header(data: bytes, path: Path) -> Header:
    match = re.search(rb"\nend_header[ \t]*\r?\n", data[:MAX_HEADER_BYTES])
    if not data.startswith(b"ply") or match is None:
        raise SceneError(f"{path}: not a PLY file, or cut within its header; export the points again")
    lines = [line.split() for line in data[: match.start()].decode("latin-1").splitlines()]
    words = [line for line in lines if line and line[0] in ("format", "element", "property")]
    order = next((line[1] for line in words if line[0] == "format" and len(line) > 1), "")
    first = next((index for index, line in enumerate(words) if line[0] == "element"), len(words))
    element = words[first] if first < len(words) else []
    if order not in BYTE_ORDERS or element[1:2] != ["vertex"] or not re.fullmatch(r"\d{1,12}", "".join(element[2:])):
        raise SceneError(f"{path}: a PLY file that does not begin with vertices; export the points again")
    columns: list[tuple[str, str]] = []
    for line in words[first + 1 :]:
        if line[0] == "element":
            break
        if len(line) != 3 or line[1] not in TYPES:
            raise SceneError(f"{path}: vertex property {' '.join(line[1:])!r} is not a number; export the points again")
        columns.append((line[2], BYTE_ORDERS[order] + TYPES[line[1]]))
    names = [name for name, _ in columns]
    if len(set(names)) < len(names) or not {"x", "y", "z"} <= set(names):
        raise SceneError(f"{path}: vertices without x, y and z, each once; export the points again")
    return Header(order == "ascii", np.dtype(columns), int(element[2]), match.end())


def _binary_columns(data: bytes, header: Header, path: Path) -> dict[str, np.ndarray]:
    room = (len(data) - header.start) // header.dtype.itemsize
    if header.count > room:
        raise SceneError(f"{path}: promises {header.count} vertices and has room for {room}; copy the file again")
    vertices = np.frombuffer(data, header.dtype, header.count, header.start)
    return {name: vertices[name] for name in header.dtype.names or ()}


def _ascii_columns(data: bytes, header: Header, path: Path) -> dict[str, np.ndarray]:
    names = header.dtype.names or ()
    needed, remaining = header.count * len(names), len(data) - header.start
    # A number takes at least a digit and a blank: an absurd count is refused before the words are listed.
    words = data[header.start :].split(maxsplit=needed) if 2 * needed <= remaining + 1 else []
    if needed > len(words):
        raise SceneError(f"{path}: promises {header.count} vertices and ends before; copy the file again")
    try:
        # One by one: an array of the words would give each the width of the longest, which a stranger may choose.
        table = np.fromiter(map(float, words[:needed]), np.float64, needed).reshape(header.count, len(names))
    except ValueError as error:
        raise SceneError(f"{path}: a vertex is not made of numbers; export the points again") from error
    return dict(zip(names, table.T, strict=True))


def _colors(columns: dict[str, np.ndarray], header: Header) -> Float[np.ndarray, "P 3"]:
    if not set(COLOR_NAMES) <= set(columns):
        return np.full((header.count, 3), 0.5)
    channels = []
    for name in COLOR_NAMES:
        declared = header.dtype[name]
        full = np.iinfo(declared).max if declared.kind in "iu" else 1
        channels.append(columns[name].astype(np.float64) / full)
    return np.stack(channels, -1)
