"""Layers as numbers on disk: 16-bit PNG, float32 EXR, float32 NPY. What a number means stands beside them, see
``files/camera_records.py``."""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import BinaryIO, Literal

import numpy as np
from jaxtyping import Float, UInt16
from torch import Tensor

from ringlight.errors import BackendError
from ringlight.files.atomic import written_atomically

NumberFormat = Literal["png16", "exr", "npy"]

SUFFIXES: dict[str, str] = {"png": ".png", "png16": ".png", "exr": ".exr", "npy": ".npy"}

TOP = 65535
"""The largest of 16 bits."""

SIGNED = ("residual", "normal")
"""Layers in [-1, 1]; all others but depth are in [0, 1]."""

EXR_CHANNELS = {"depth": "Z", "alpha": "A", "modulation": "Y"}
"""By OpenEXR's usual names; colours are R, G, B."""

EXR_NORMALS = ("N.X", "N.Y", "N.Z")


@dataclass(frozen=True)
class Scale:
    """How a layer's numbers are stored in 16 bits: ``value = low + stored * step``."""

    low: float
    step: float


def scale_of(layer: str, deepest: float) -> Scale:
    """``deepest``, world units, is the largest depth that can be stored."""
    if layer == "depth":
        return Scale(0.0, deepest / TOP)
    return Scale(-1.0, 2 / TOP) if layer in SIGNED else Scale(0.0, 1 / TOP)


def write_numbers(path: Path, layer: str, values: Float[Tensor, "H W c"], scale: Scale) -> None:
    """One layer of one picture, all or nothing; the suffix names the format, and ``scale`` is of 16 bits alone.

    Raises OutputError, and BackendError for EXR without its library.
    """
    array = np.ascontiguousarray(values.detach().cpu().float().numpy())
    with written_atomically(path) as file:
        WRITERS[path.suffix](file, layer, array, scale)


def exr_library() -> ModuleType:
    """OpenEXR's own module. Raises BackendError where the extra is not installed."""
    try:
        import OpenEXR
    except ImportError as error:
        remedy = 'pip install "ringlight[exr]", or take --format npy, which holds the same numbers'
        raise BackendError(f"EXR files need the exr extra: {remedy}") from error
    return OpenEXR


def png16(stored: UInt16[np.ndarray, "H W c"]) -> bytes:
    """A PNG of one (gray) or three (RGB) channels of 16 bits, which Pillow cannot write (PNG, third edition, W3C)."""
    height, width, channels = stored.shape
    # Each row begins with the filter that it went through: 0, none.
    rows = np.zeros((height, 1 + width * channels * 2), np.uint8)
    rows[:, 1:] = stored.astype(">u2").reshape(height, -1).view(np.uint8)
    kind = {1: 0, 3: 2}[channels]
    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), PNG_EFFORT)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, content) for name, content in chunks)


PNG_EFFORT = 6
"""Of zlib, 0 to 9."""


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def _as_png16(file: BinaryIO, layer: str, values: Float[np.ndarray, "H W c"], scale: Scale) -> None:
    stored = np.rint((np.nan_to_num(values.astype(np.float64)) - scale.low) / scale.step)
    file.write(png16(stored.clip(0, TOP).astype(np.uint16)))


def _as_npy(file: BinaryIO, layer: str, values: Float[np.ndarray, "H W c"], scale: Scale) -> None:
    """NumPy's format: [H W] of one channel, else [H W c]."""
    np.save(file, values[..., 0] if values.shape[-1] == 1 else values)


def _as_exr(file: BinaryIO, layer: str, values: Float[np.ndarray, "H W c"], scale: Scale) -> None:
    library = exr_library()
    names = EXR_NORMALS if layer == "normal" else tuple("RGB") if values.shape[-1] == 3 else (EXR_CHANNELS[layer],)
    channels = {name: np.ascontiguousarray(values[..., index]) for index, name in enumerate(names)}
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    try:
        # The library writes to names alone: to that of the file which takes its own name when it is whole.
        library.File(header, channels).write(file.name)
    except RuntimeError as error:  # of the library, which does not say which
        raise OSError(f"OpenEXR cannot write it: {error}") from error


WRITERS: dict[str, Callable[[BinaryIO, str, np.ndarray, Scale], None]] = {
    ".png": _as_png16,
    ".npy": _as_npy,
    ".exr": _as_exr,
}
