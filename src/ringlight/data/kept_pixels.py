"""Pixels that cost much to make, kept from one command to the next: who keeps them, and how they are known again."""

import hashlib
from dataclasses import astuple
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8
from PIL import features

from ringlight.data.mask_files import MaskFile
from ringlight.data.undistort import Undistortion

MAKERS = (
    "deep_images", "image_files", "image_formats", "images", "intrinsics", "lens", "mask_files", "resample",
    "stored_tiff", "undistort",
)  # fmt: skip
"""Modules of this folder that take part in making the pixels: where one is changed, all pixels are made anew."""

LIBRARIES = ("numpy", "pillow", "scipy", "pi_heif", "pillow_heif")
"""Others' that do."""

DIGEST_BYTES = 16
"""Of BLAKE2b: no two photographs of all that there are share it by chance."""

READ_AT_ONCE = 1 << 20
"""Bytes of a file."""


@runtime_checkable
class Keeper(Protocol):
    """Keeps pixels under the names of photographs; asked by several threads, and never raises."""

    def find(self, name: str, made_of: str) -> UInt8[np.ndarray, "H W C"] | None:
        """The pixels that were kept under that name, if they are whole and ``made_of`` the same; else None."""
        ...

    def keep(self, name: str, made_of: str, pixels: UInt8[np.ndarray, "H W C"]) -> None:
        """Keep them, in place of what was kept under that name, if that can be."""
        ...


def made_of(path: Path, mask: MaskFile | None, undistortion: Undistortion) -> str | None:
    """What an undistorted photograph depends on, as one word: the bytes of its files, the lens, the size, the code and
    the libraries. None where a file cannot be read.

    Files are known by their bytes and not by their dates, which copies share or lose: to read and sum a photograph
    takes a hundredth of the time of undistorting it.
    """
    try:
        masked = mask and (mask.is_inverted, mask.path and _digest(mask.path))
        parts = (_code(), _digest(path), masked, astuple(undistortion))
    except OSError:
        return None
    return hashlib.blake2b(repr(parts).encode(), digest_size=DIGEST_BYTES).hexdigest()


def _digest(path: Path) -> str:
    summed = hashlib.blake2b(digest_size=DIGEST_BYTES)
    with path.open("rb") as file:
        while read := file.read(READ_AT_ONCE):
            summed.update(read)
    return summed.hexdigest()


@lru_cache(maxsize=1)
def _code() -> tuple[object, ...]:
    """What makes the pixels. Raises OSError where it lies in no files."""
    ours = tuple(_digest(Path(__file__).with_name(f"{name}.py")) for name in MAKERS)
    return ours, tuple(map(_version, LIBRARIES)), features.version_feature("libjpeg_turbo")


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None
