"""Photographs: size and transparency from the header at once, pixels on first use, kept as 8 bit.

One filter shrinks images everywhere: Lanczos with three lobes whose support grows with the factor (antialiased);
colours are premultiplied by alpha meanwhile, so that what is hidden under transparent pixels does not bleed.

A decoded image stays in memory as 8 bit: 400 photographs of 1600 x 1066 take 2.0 GB. As floats they would take
8 GB, and decoding a JPEG of that size again at each step costs more than a training step. Of a scene that does not fit
its share of the memory as many stay as fit, and the others are decoded each time: with views in random order no rule
for exchanging them finds more of them in memory. An EXIF orientation is
not applied, because camera poses are solved on the pixels as stored.
"""

import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, UnidentifiedImageError

from ringlight.data.options import SceneOptions
from ringlight.errors import SceneError

FILTER_NOTE = "Lanczos (3 lobes, antialiased, on colours premultiplied by alpha)"
"""What every scene with shrunk images states."""

EIGHT_BIT_MODES = frozenset({"1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr", "La", "RGBa"})
"""Pillow's modes whose conversion to RGB keeps the brightness; of 16-bit grey it would clip all but the darkest."""

BROKEN_IMAGE = (
    OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, KeyError, OverflowError, MemoryError,
    struct.error, zlib.error, Image.DecompressionBombError, Image.DecompressionBombWarning,
)  # fmt: skip
"""What Pillow's decoders raise on damaged files."""


FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TIFF")
"""What photographs come as; Pillow knows others, one of which runs a program to be read."""

PIXELS_A_BYTE = 8 * 1032
"""Deflate packs 1032 bytes into one at most, and a byte holds up to eight pixels: no file with more is whole."""


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says of itself before it is decoded; sizes in pixels."""

    width: int
    height: int
    has_alpha: bool


def read_header(path: Path) -> ImageHeader:
    """Size and transparency of an image file, without decoding it.

    Raises:
        SceneError: not an image that can be read, or of more than 8 bits a channel.
    """
    try:
        with _opened(path) as image:
            mode, has_alpha = image.mode, _has_alpha(image)
            width, height = image.size
    except BROKEN_IMAGE as error:
        raise _unreadable(path, error) from error
    if mode not in EIGHT_BIT_MODES:
        raise SceneError(f"{path}: has pixels of kind {mode!r}; convert the image to 8-bit RGB")
    return ImageHeader(width, height, has_alpha)


def target_size(width: int, height: int, options: SceneOptions) -> tuple[int, int]:
    """Width and height, in pixels, at which an image of that size is used."""
    if options.downscale is not None:
        return max(1, round(width / options.downscale)), max(1, round(height / options.downscale))
    if width > options.max_width:
        return options.max_width, max(1, round(height * options.max_width / width))
    return width, height


@dataclass
class PixelBudget:
    """Bytes that the photographs of one scene may keep between them."""

    left: int

    def take(self, size: int) -> bool:
        """Whether ``size`` more bytes may be kept; they then count."""
        if size > self.left:
            return False
        self.left -= size
        return True


@dataclass
class Photograph:
    """An image file at a chosen size; call it for the pixels, are decoded once, and kept while ``budget`` lasts."""

    path: Path
    width: int
    height: int
    budget: PixelBudget | None = None
    pixels: UInt8[np.ndarray, "H W C"] | None = field(default=None, init=False, repr=False)

    def __call__(self) -> UInt8[np.ndarray, "H W C"]:
        """The pixels, display-referred sRGB, three channels or four with straight alpha; not to be written to.

        Raises:
            SceneError: the file is damaged or gone.
        """
        if self.pixels is not None:
            return self.pixels
        pixels = self._decode()
        if self.budget is None or self.budget.take(pixels.nbytes):
            self.pixels = pixels
        return pixels

    def _decode(self) -> UInt8[np.ndarray, "H W C"]:
        try:
            with _opened(self.path) as image:
                colors = image.convert("RGBA" if _has_alpha(image) else "RGB")
        except BROKEN_IMAGE as error:
            raise _unreadable(self.path, error) from error
        if colors.size != (self.width, self.height):
            # Pillow premultiplies RGBA by itself around every filter but NEAREST.
            colors = colors.resize((self.width, self.height), Image.Resampling.LANCZOS)
        return np.array(colors)


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    """The image, not decoded yet; ValueError or Pillow's own for one that promises absurdly many pixels."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)  # its limit: 89 million pixels
        with Image.open(path, formats=FORMATS) as image:
            width, height = image.size
            if width * height > PIXELS_A_BYTE * path.stat().st_size:
                raise ValueError(f"promises {width}x{height} pixels, more than its bytes can hold")
            yield image


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info


def _unreadable(path: Path, error: BaseException) -> SceneError:
    if isinstance(error, UnidentifiedImageError):
        reason = "of no known format"
    elif isinstance(error, OSError) and error.strerror:
        reason = error.strerror
    else:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return SceneError(f"{path}: not a readable image ({reason}); copy or export the image again")
