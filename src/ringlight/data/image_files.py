"""Files of images: what one says of itself, and its pixels as 8 bit. What is damaged or hostile is one sentence.

An EXIF orientation is not applied, because camera poses are solved on the pixels as stored.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from ringlight.core.lost_disk import LOST_DISK, MOUNT_AGAIN
from ringlight.data.deep_images import from_sixteen_bits, has_transparency, is_deep
from ringlight.data.image_formats import KNOWN, identified
from ringlight.errors import SceneError

EIGHT_BIT_MODES = frozenset({"1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr", "La", "RGBa"})
"""Pillow's modes whose conversion to RGB keeps the brightness; of 16-bit grey it would clip all but the darkest."""

BROKEN_IMAGE = (
    OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, KeyError, OverflowError, MemoryError,
    RuntimeError, struct.error, zlib.error, Image.DecompressionBombError, Image.DecompressionBombWarning,
)  # fmt: skip
"""What Pillow's decoders and libheif raise on damaged files."""

MOST_PIXELS = 89_478_485
"""Of an image: Pillow's own bound, a quarter of a gigabyte once decoded."""

PIXELS_A_BYTE = 8 * 1032
"""Deflate packs 1032 bytes into one at most, and a byte holds up to eight pixels: no file with more is whole."""

PIXELS_A_BYTE_OF = dict.fromkeys(("WEBP", "TIFF", "AVIF", "HEIF"), 8 * PIXELS_A_BYTE)
"""These pack an even area tighter: a mask of 12 million pixels with one rectangle into 544 bytes of WebP, or 1,062 of
TIFF. Their formats set no bound, and this one only keeps small files from asking for much memory."""


class TooLargeError(ValueError):
    """More pixels than are read."""


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says of itself before it is decoded; sizes in pixels."""

    width: int
    height: int
    has_alpha: bool
    is_deep: bool = False
    """Whether its 16 bits a channel are rounded to 8."""


def read_header(path: Path) -> ImageHeader:
    """Size and transparency of an image file, without decoding it.

    Raises:
        SceneError: not an image that can be read, or of other numbers than 8 or 16 bits a channel.
    """
    try:
        with opened(path) as image:
            mode, has_alpha, deep = image.mode, _has_alpha(image), is_deep(image)
            width, height = image.size
    except BROKEN_IMAGE as error:
        raise unreadable(path, error) from error
    if mode not in EIGHT_BIT_MODES and not deep:
        raise SceneError(f"{path}: has pixels of kind {mode!r}; convert the image to RGB of 8 or 16 bits a channel")
    return ImageHeader(width, height, has_alpha, deep)


def decoded(path: Path, keeps_labels: bool = False) -> Image.Image:
    """The pixels, RGB or RGBA with straight alpha. Of 16 bits a channel 0 and 1, where there are no others, stay so if
    ``keeps_labels``; they are black else.

    Raises:
        SceneError: the file is damaged or gone.
    """
    try:
        with opened(path) as image:
            if is_deep(image):
                return from_sixteen_bits(image, lambda: identified(path), keeps_labels)
            return image.convert("RGBA" if _has_alpha(image) else "RGB")
    except BROKEN_IMAGE as error:
        raise unreadable(path, error) from error


@contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """The image, not decoded yet. Raises TooLargeError, or ValueError where its bytes cannot hold its pixels."""
    with identified(path) as image:
        width, height = image.size
        if width * height > PIXELS_A_BYTE_OF.get(image.format or "", PIXELS_A_BYTE) * path.stat().st_size:
            raise ValueError(f"promises {width}x{height} pixels, more than its bytes can hold")
        if width * height > MOST_PIXELS:
            raise TooLargeError(f"{width}x{height} pixels")
        yield image


def _has_alpha(image: Image.Image) -> bool:
    if is_deep(image):
        return has_transparency(image)
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info


def unreadable(path: Path, error: BaseException) -> SceneError:
    """The sentence for what :func:`opened` or decoding raised."""
    if isinstance(error, TooLargeError):
        most = f"{MOST_PIXELS // 1_000_000} million"
        return SceneError(f"{path}: has {error}, and images are read up to {most}; put a smaller copy in its place")
    if isinstance(error, UnidentifiedImageError):
        reason = f"of no known format; {KNOWN} are read"
    elif isinstance(error, OSError) and error.strerror:
        if error.errno in LOST_DISK:
            return SceneError(f"{path}: cannot be read ({error.strerror}); {MOUNT_AGAIN}")
        reason = error.strerror
    else:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return SceneError(f"{path}: not a readable image ({reason}); copy or export the image again")
