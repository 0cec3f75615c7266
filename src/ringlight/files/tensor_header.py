"""The header of a safetensors file: what it must be before a byte of the data is read.

Every size is checked against the file, so that none is allocated that the file does not have, and what is wrong is
named in one sentence.
"""

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import torch

from ringlight.core.command_line import command
from ringlight.core.json_numbers import refuse_constant
from ringlight.core.words import counted
from ringlight.errors import ModelFileError

DTYPES = {
    "F64": torch.float64,
    "F32": torch.float32,
    "F16": torch.float16,
    "BF16": torch.bfloat16,
    "I64": torch.int64,
    "I32": torch.int32,
    "I16": torch.int16,
    "I8": torch.int8,
    "U8": torch.uint8,
    "BOOL": torch.bool,
}
"""The types we write and read, by their safetensors names."""

NAMES = {dtype: name for name, dtype in DTYPES.items()}

METADATA = "__metadata__"

LENGTH_BYTES = 8
"""Before the header, which they count."""

LARGEST_HEADER = 100_000_000
"""Bytes; the format's own limit, so that a damaged length cannot ask for the whole memory."""

MOST_DIMENSIONS = 16
"""More than any tensor of ours has; torch's own limit is not checked everywhere."""

REMEDY = "copy it again from where it was made, or make it again"


@dataclass(frozen=True)
class Place:
    """Where a tensor lies: its type and shape, first and last byte counted from the start of the data."""

    dtype: torch.dtype
    shape: tuple[int, ...]
    begin: int
    end: int


def read_header(path: Path, file: BinaryIO) -> tuple[dict[str, str], dict[str, Place], bytes]:
    """Metadata with the checksum, the places in the order of the data, and the bytes that said so. ``file`` is one that
    can be sought; it is left at the first data byte. ``path`` is its name in messages. Raises ModelFileError for what
    is cut, damaged or another format."""
    size = file.seek(0, 2)
    file.seek(0)
    if size == 0:
        raise ModelFileError(f"{path}: the file is empty; {REMEDY}")
    start = file.read(9)
    # Every safetensors header begins with a brace: whatever does not is some other file, not a damaged one.
    if len(start) == 9 and start[8:] != b"{":
        remedy = "name a model.safetensors written by ringlight"
        if start.startswith(b"ply"):
            remedy = f"make a model of the PLY by: {command('import', path)}"
        raise ModelFileError(f"{path}: is not a safetensors file; {remedy}")
    length = struct.unpack("<Q", start[:8])[0] if len(start) == 9 else 1
    if length > LARGEST_HEADER:
        raise ModelFileError(f"{path}: the file is damaged: it announces a header of {length} bytes; {REMEDY}")
    if len(start) < 9 or length > size - 8:
        raise ModelFileError(f"{path}: the file is cut short inside its header; {REMEDY}")
    file.seek(8)
    encoded = file.read(length)
    header = _parse(path, encoded)
    metadata = header.pop(METADATA, {})
    if not isinstance(metadata, dict) or not all(
        _is_text(name) and _is_text(value) for name, value in metadata.items()
    ):
        raise ModelFileError(f"{path}: the file is damaged: its metadata are not strings; {REMEDY}")
    if not all(map(_is_text, header)):
        raise ModelFileError(f"{path}: the file is damaged: a tensor's name is no text; {REMEDY}")
    places = {name: _place(path, name, entry) for name, entry in header.items()}
    return metadata, _checked(path, places, size - 8 - length), encoded


def _is_text(value: object) -> bool:
    """Whether it can be written again: JSON may name halves of characters, which no file and no terminal takes."""
    return isinstance(value, str) and not any("\ud800" <= character <= "\udfff" for character in value)


def _parse(path: Path, encoded: bytes) -> dict[str, object]:
    try:
        header = json.loads(encoded.decode(), parse_constant=refuse_constant)
    # ValueError covers bad UTF-8, bad JSON and absurd numbers; deep nesting ends in a RecursionError.
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path}: the file is damaged: its header is not JSON; {REMEDY}") from error
    if not isinstance(header, dict):
        raise ModelFileError(f"{path}: the file is damaged: its header is not a JSON object; {REMEDY}")
    return header


def _place(path: Path, name: str, entry: object) -> Place:
    """One entry of the header. Raises ModelFileError unless type, shape and bytes agree."""
    fields = entry if isinstance(entry, dict) else {}
    dtype = DTYPES.get(fields["dtype"]) if isinstance(fields.get("dtype"), str) else None
    if dtype is None:
        known = ", ".join(DTYPES)
        raise ModelFileError(f"{path}: tensor {name!r} has an unknown type (known: {known}); {REMEDY}")
    shape, offsets = _naturals(fields.get("shape")), _naturals(fields.get("data_offsets"))
    if shape is None or offsets is None or len(offsets) != 2 or len(shape) > MOST_DIMENSIONS:
        raise ModelFileError(f"{path}: the file is damaged: tensor {name!r} has no valid shape and place; {REMEDY}")
    # Zeros are counted as ones against the largest index: torch cannot hold [0, 2**70] either.
    if math.prod(max(length, 1) for length in shape) * dtype.itemsize >= 2**63:
        raise ModelFileError(f"{path}: the file is damaged: tensor {name!r} has an absurd shape; {REMEDY}")
    if offsets[1] - offsets[0] != math.prod(shape) * dtype.itemsize:
        raise ModelFileError(f"{path}: the file is damaged: tensor {name!r} has the wrong number of bytes; {REMEDY}")
    return Place(dtype, shape, offsets[0], offsets[1])


def _naturals(values: object) -> tuple[int, ...] | None:
    if isinstance(values, list) and all(type(value) is int and value >= 0 for value in values):
        return tuple(values)
    return None


def _checked(path: Path, places: dict[str, Place], data_bytes: int) -> dict[str, Place]:
    """The places in the order of the data, which they must cover without gap or overlap."""
    ordered = dict(sorted(places.items(), key=lambda item: (item[1].begin, item[1].end)))
    reached = 0
    for name, place in ordered.items():
        if place.begin != reached:
            raise ModelFileError(f"{path}: the file is damaged: tensor {name!r} overlaps or leaves a gap; {REMEDY}")
        reached = place.end
    if reached > data_bytes:
        raise ModelFileError(f"{path}: the file is cut short by {counted(reached - data_bytes, 'byte')}; {REMEDY}")
    if reached < data_bytes:
        raise ModelFileError(f"{path}: the file is damaged: {counted(data_bytes - reached, 'byte')} too many; {REMEDY}")
    return ordered
