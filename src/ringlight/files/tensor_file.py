"""Named tensors and string metadata in one safetensors file; used by models and checkpoints alike.

The format (https://huggingface.co/docs/safetensors): eight bytes of header length, little endian; a JSON header
``{"__metadata__": {...}, name: {"dtype", "shape", "data_offsets"}}``; the data. It is read and written here,
because the same content must give the same bytes (the library orders metadata by chance), every size must be
checked against the file before memory is allocated, and a damaged file must be named in one sentence: our files carry
a checksum of every byte, in the metadata and taken as if its own digits were zeros.
"""

import hashlib
import json
import math
import os
import struct
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import torch
from torch import Tensor

from ringlight.core.command_line import command
from ringlight.core.json_numbers import refuse_constant
from ringlight.core.lost_disk import what_helps
from ringlight.core.words import counted
from ringlight.errors import ModelFileError
from ringlight.files.atomic import written_atomically

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

CHECKSUM = "ringlight.checksum"
"""Reserved among the metadata, and never shown with them; files of other programs have none."""

CHECKSUM_BYTES = 8
"""Of BLAKE2b: against accidents, which 64 bits let through never; no protection against a forger."""

LENGTH_BYTES = 8
"""Before the header, which they count."""

BLANK = "0" * 2 * CHECKSUM_BYTES

LARGEST_HEADER = 100_000_000
"""Bytes; the format's own limit, so that a damaged length cannot ask for the whole memory."""

ALIGNMENT = 8
"""The data start at a multiple of this, as the format asks, so that a reader may map every type in place."""

MOST_DIMENSIONS = 16
"""More than any tensor of ours has; torch's own limit is not checked everywhere."""

REMEDY = "copy it again from where it was made, or make it again"


@dataclass(frozen=True)
class TensorFile:
    """What a file holds: tensors on the CPU and strings, by name."""

    tensors: dict[str, Tensor]
    metadata: dict[str, str]


@dataclass(frozen=True)
class _Place:
    """Where a tensor lies: its type and shape, first and last byte counted from the start of the data."""

    dtype: torch.dtype
    shape: tuple[int, ...]
    begin: int
    end: int


def write_tensors(
    path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str], *, flushed: bool = True
) -> None:
    """Write all or nothing, with a checksum; equal content gives equal bytes. Raises OutputError.

    What can be made anew need not be ``flushed``: a power cut may damage it then, which its checksum tells.
    """
    # Wide types first, then by name: with the aligned start this keeps every tensor aligned to its own type.
    ordered = sorted(tensors.items(), key=lambda item: (-item[1].element_size(), item[0]))
    header: dict[str, object] = {METADATA: {CHECKSUM: BLANK} | dict(sorted(metadata.items()))}
    begin = 0
    for name, tensor in ordered:
        end = begin + tensor.numel() * tensor.element_size()
        header[name] = {"dtype": NAMES[tensor.dtype], "shape": list(tensor.shape), "data_offsets": [begin, end]}
        begin = end
    encoded = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    encoded += b" " * (-len(encoded) % ALIGNMENT)
    values = [_bytes_of(tensor.detach().cpu().contiguous()) for _, tensor in ordered]
    with written_atomically(path, flushed) as file, ThreadPoolExecutor(1) as another:
        # Bytes are summed while the disk takes them: either alone is half of what a checkpoint costs.
        checksum = another.submit(_checksum, encoded, values)
        file.write(struct.pack("<Q", len(encoded)))
        file.write(encoded)
        for value in values:
            file.write(value)
        if flushed:
            file.flush()
            os.fsync(file.fileno())
        file.seek(LENGTH_BYTES)
        file.write(encoded.replace(_stated(BLANK), _stated(checksum.result()), 1))


def read_tensors(path: Path, *, checksum_required: bool = False) -> TensorFile:
    """The whole file. Raises ModelFileError for a file that is missing, cut, damaged or something else."""
    with _opened(path) as file:
        metadata, places, encoded = _read_header(path, file)
        tensors = {name: _read_tensor(path, file, place) for name, place in places.items()}
    stated = metadata.pop(CHECKSUM, None)
    if stated is None and checksum_required:
        raise ModelFileError(f"{path}: the file is damaged: it has no checksum; {REMEDY}")
    if stated is not None:
        blanked = encoded.replace(_stated(stated), _stated(BLANK), 1)
        if stated != _checksum(blanked, map(_bytes_of, tensors.values())):
            raise ModelFileError(
                f"{path}: the file is damaged: its checksum is another than that of its bytes; {REMEDY}"
            )
    return TensorFile(tensors, metadata)


def read_metadata(path: Path) -> dict[str, str]:
    """The strings alone, without reading the tensors; sizes are checked all the same, the checksum is not."""
    with _opened(path) as file:
        metadata, _, _ = _read_header(path, file)
    metadata.pop(CHECKSUM, None)
    return metadata


def _checksum(encoded: bytes, values: Iterable[memoryview]) -> str:
    """Of the header with a blank checksum, and the data."""
    summed = hashlib.blake2b(encoded, digest_size=CHECKSUM_BYTES)
    for value in values:
        summed.update(value)
    return summed.hexdigest()


def _stated(checksum: str) -> bytes:
    """The checksum's entry as it stands in a header of ours."""
    return f'"{CHECKSUM}":"{checksum}"'.encode()


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with Path(path).open("rb") as file:
            yield file
    except FileNotFoundError as error:
        raise ModelFileError(f"{path}: there is no such file; check the path") from error
    except IsADirectoryError as error:
        raise ModelFileError(f"{path}: is a folder, not a file; name a file inside it") from error
    except OSError as error:
        check = what_helps(error, "check the path, its permissions and the disk")
        raise ModelFileError(f"{path}: cannot be read: {error.strerror}; {check}") from error


def _bytes_of(tensor: Tensor) -> memoryview:
    """The memory of a contiguous tensor, seen as bytes."""
    return tensor.reshape(-1).view(torch.uint8).numpy().data


def _read_tensor(path: Path, file: BinaryIO, place: _Place) -> Tensor:
    tensor = torch.empty(place.shape, dtype=place.dtype)
    if file.readinto(_bytes_of(tensor)) != place.end - place.begin:  # type: ignore[attr-defined]
        raise ModelFileError(f"{path}: the file shrank while it was read; {REMEDY}")
    return tensor


def _read_header(path: Path, file: BinaryIO) -> tuple[dict[str, str], dict[str, _Place], bytes]:
    """Metadata with the checksum, the places in the order of the data, and the bytes that said so; leaves ``file`` at
    the first data byte."""
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


def _place(path: Path, name: str, entry: object) -> _Place:
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
    return _Place(dtype, shape, offsets[0], offsets[1])


def _naturals(values: object) -> tuple[int, ...] | None:
    if isinstance(values, list) and all(type(value) is int and value >= 0 for value in values):
        return tuple(values)
    return None


def _checked(path: Path, places: dict[str, _Place], data_bytes: int) -> dict[str, _Place]:
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
