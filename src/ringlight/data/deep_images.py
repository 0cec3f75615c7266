"""Images of 16 bits a channel, rounded to 8: 65535 becomes 255, and each number the nearest.

Pillow keeps 16 bits of grey. Of colours it keeps the high byte alone, so that rounding needs a second look: decoded as
if its bytes stood in the other order, the same file gives the low ones.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

DEEP_GREY = ("I;16", "I;16B", "I;16L", "I;16N")
"""Pillow's modes of 16-bit grey."""

DEEP_COLORS = (";16B", ";16L", ";16N")
"""Ends of the names of 16-bit colours as files store them: big endian, little endian, as the machine."""


def is_deep(image: Image.Image) -> bool:
    """Whether an image that is not decoded yet has 16 bits a channel that can be rounded."""
    return image.mode in DEEP_GREY or (image.mode in ("RGB", "RGBA") and _stored(image) is not None)


def from_sixteen_bits(image: Image.Image, again: Callable[[], Image.Image]) -> Image.Image:
    """RGB or RGBA of 8 bits; ``again`` opens the same file a second time. Raises what Pillow's decoders raise."""
    if image.mode in DEEP_GREY:
        values = np.asarray(image)
        return Image.fromarray(rounded((values >> 8).astype(np.uint8), (values & 255).astype(np.uint8))).convert("RGB")
    with again() as turned:
        _turn_bytes(turned)
        return Image.fromarray(rounded(np.asarray(image), np.asarray(turned)))


def rounded(high: UInt8[np.ndarray, "*shape"], low: UInt8[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape"]:
    """``(256 · high + low) / 257`` to the nearest whole number; half never occurs, 257 being odd."""
    # v = 257 · high + (low - high), and the bracket is less than 257 either way.
    rest = low.astype(np.int16) - high
    nearest: UInt8[np.ndarray, "*shape"] = (high + (rest > 128) - (rest < -128)).astype(np.uint8)
    return nearest


def _stored(image: Image.Image) -> str | None:
    """Pillow's name for how all pieces of the file store 16-bit colours; None for any other image."""
    names = {_name(tile[3]) for tile in getattr(image, "tile", ())}
    name = names.pop() if len(names) == 1 else None
    return name if name in [image.mode + end for end in DEEP_COLORS] else None


def _name(arguments: object) -> str:
    first = arguments[0] if isinstance(arguments, tuple) and arguments else arguments
    return first if isinstance(first, str) else ""


def _turn_bytes(image: Image.Image) -> None:
    """Have the image decoded with the two bytes of each number exchanged."""
    is_little = (_stored(image) or "").endswith((";16L", ";16N") if sys.byteorder == "little" else ";16L")
    name = f"{image.mode}{';16B' if is_little else ';16L'}"
    image.tile = [_stored_as(name, tile) for tile in image.tile]  # type: ignore[attr-defined]  # of opened files


def _stored_as(name: str, tile: tuple[Any, ...]) -> tuple[Any, ...]:
    """The piece of a file with that name in the first of its arguments. Pillow before 11 has plain tuples of decoder,
    extents, offset and arguments, and named ones since, whose names its decoding asks for."""
    *place, arguments = tile
    make = getattr(tile, "_make", tuple)
    piece: tuple[Any, ...] = make((*place, (name, *arguments[1:]) if isinstance(arguments, tuple) else name))
    return piece
