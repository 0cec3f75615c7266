"""Named tensors and string metadata in one safetensors file; used by models and checkpoints alike.

The format (https://huggingface.co/docs/safetensors): eight bytes of header length, little endian; a JSON header
``{"__metadata__": {...}, name: {"dtype", "shape", "data_offsets"}}``; the data. It is read and written here,
because the same content must give the same bytes (the library orders metadata by chance), every size must be
checked against the file before memory is allocated (``tensor_header.py``), and a damaged file must be named in one
sentence: our files carry a checksum of every byte, in the metadata and taken as if its own digits were zeros.
"""

import hashlib
import json
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

from ringlight.core.lost_disk import what_helps
from ringlight.errors import ModelFileError
from ringlight.files.atomic import written_atomically
from ringlight.files.tensor_header import LENGTH_BYTES, METADATA, NAMES, REMEDY, Place, read_header

CHECKSUM = "ringlight.checksum"
"""Reserved among the metadata, and never shown with them; files of other programs have none."""

CHECKSUM_BYTES = 8
"""Of BLAKE2b: against accidents, which 64 bits let through never; no protection against a forger."""

BLANK = "0" * 2 * CHECKSUM_BYTES

ALIGNMENT = 8
"""The data start at a multiple of this, as the format asks, so that a reader may map every type in place."""


@dataclass(frozen=True)
class TensorFile:
    """What a file holds: tensors on the CPU and strings, by name."""

    tensors: dict[str, Tensor]
    metadata: dict[str, str]


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
        metadata, places, encoded = read_header(path, file)
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
        metadata, _, _ = read_header(path, file)
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


def _read_tensor(path: Path, file: BinaryIO, place: Place) -> Tensor:
    tensor = torch.empty(place.shape, dtype=place.dtype)
    if file.readinto(_bytes_of(tensor)) != place.end - place.begin:  # type: ignore[attr-defined]
        raise ModelFileError(f"{path}: the file shrank while it was read; {REMEDY}")
    return tensor
