"""Images of 16 bits a channel, rounded to 8: 65535 becomes 255, and each number the nearest.

Pillow keeps 16 bits of grey. Of colours it keeps the high byte alone, so that rounding needs a second look: decoded as
if its bytes stood in the other order, the same file gives the low ones.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

Bytes = UInt8[np.ndarray, "H W C"]

OPAQUE = 255

DEEP_GREY = ("I;16", "I;16B", "I;16L", "I;16N")
"""Pillow's modes of 16-bit grey."""

DEEP_COLORS = (";16B", ";16L", ";16N")
"""Ends of the names of 16-bit colours as files store them: big endian, little endian, as the machine."""


def is_deep(image: Image.Image) -> bool:
    """Whether an image that is not decoded yet has 16 bits a channel that can be rounded."""
    return image.mode in DEEP_GREY or (image.mode in ("RGB", "RGBA") and _stored(image) is not None)


def has_transparency(image: Image.Image) -> bool:
    """Whether the colours of a deep image come with alpha, or with one that is transparent (PNG's tRNS)."""
    return image.mode == "RGBA" or "transparency" in image.info


def from_sixteen_bits(image: Image.Image, again: Callable[[], Image.Image], keeps_labels: bool = False) -> Image.Image:
    """RGB or RGBA of 8 bits; ``again`` opens the same file a second time. Raises what Pillow's decoders raise.

    Colours of which none is above 1 of 65535, as labels are stored, stay 0 and 1 if ``keeps_labels``.
    """
    transparent = image.info.get("transparency")
    high, low = _bytes(image, again)
    eight = rounded(high, low)
    colors = slice(0, 3)
    if keeps_labels and not high[..., colors].any() and not (low[..., colors] > 1).any():
        eight[..., colors] = low[..., colors]
    picture = Image.fromarray(eight[..., 0]).convert("RGB") if eight.shape[2] == 1 else Image.fromarray(eight)
    if transparent is not None and picture.mode == "RGB":
        picture.putalpha(Image.fromarray(np.where(_equal(high, low, transparent), np.uint8(0), np.uint8(OPAQUE))))
    return picture


def _bytes(image: Image.Image, again: Callable[[], Image.Image]) -> tuple[Bytes, Bytes]:
    """The high and the low one of each number; grey has one channel."""
    if image.mode in DEEP_GREY:
        values = np.asarray(image)[..., None]
        return (values >> 8).astype(np.uint8), (values & 255).astype(np.uint8)
    with again() as turned:
        _turn_bytes(turned)
        return np.asarray(image), np.asarray(turned)


def _equal(high: Bytes, low: Bytes, color: int | tuple[int, ...]) -> Bool[np.ndarray, "H W"]:
    """Where all 16 bits are those of the colour."""
    wanted = np.asarray(color)
    same: Bool[np.ndarray, "H W"] = ((high == wanted >> 8) & (low == wanted & 255)).all(-1)
    return same


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
    piece = (*place, (name, *arguments[1:]) if isinstance(arguments, tuple) else name)
    return piece if type(tile) is tuple else type(tile)(*piece)
