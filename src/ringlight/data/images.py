"""Photographs: size and transparency from the header at once, pixels on first use, kept as 8 bit.

One filter shrinks images everywhere: Lanczos with three lobes whose support grows with the factor (antialiased);
colours are premultiplied by alpha meanwhile, so that what is hidden under transparent pixels does not bleed.

A decoded image stays in memory as 8 bit: 400 photographs of 1600 x 1066 take 2.0 GB. As floats they would take
8 GB, and decoding a JPEG of that size again at each step costs more than a training step. Of a scene that does not fit
its share of the memory as many stay as fit, and the others are decoded each time: with views in random order no rule
for exchanging them finds more of them in memory.
"""

from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from ringlight.data.file_marks import mark_of
from ringlight.data.image_files import decoded
from ringlight.data.kept_pixels import Keeper, made_of
from ringlight.data.mask_files import MaskFile
from ringlight.data.options import SceneOptions
from ringlight.data.undistort import Undistortion
from ringlight.errors import RecipeError

FILTER_NOTE = "Lanczos (3 lobes, antialiased, on colours premultiplied by alpha)"
"""What every scene with shrunk images states."""


LEAST_SIDE = 4
"""Pixels that shrinking leaves of either side; a picture of fewer shows nothing to learn from."""


def target_size(width: int, height: int, options: SceneOptions) -> tuple[int, int]:
    """Width and height, in pixels, at which an image of that size is used.

    Raises RecipeError for options that leave fewer pixels than LEAST_SIDE of a side that has them.
    """
    if options.downscale is not None:
        size = (round(width / options.downscale), round(height / options.downscale))
        asked, most = f"--downscale {options.downscale}", max(1, min(width, height) // LEAST_SIDE)
        remedy = f"give at most {most}" if most > 1 else "leave it out"
    elif width > options.max_width:
        size = (options.max_width, round(height * options.max_width / width))
        by_default = ", the default," if options.max_width == SceneOptions.max_width else ""
        asked = f"--max-width {options.max_width}{by_default}"
        remedy = f"give at least {max(LEAST_SIDE, -(-LEAST_SIDE * width // height))}"
    else:
        return width, height
    if min(size) < min(LEAST_SIDE, width, height):
        left = f"{size[0]}x{size[1]} pixels of photographs of {width}x{height}"
        raise RecipeError(f"{asked} leaves {left}; {remedy}")
    return size


class OwnLock:
    """A lock that copies of its owner do not share; they get one of their own."""

    def __init__(self) -> None:
        self._lock = Lock()

    def __reduce__(self) -> tuple[type["OwnLock"], tuple[()]]:
        return OwnLock, ()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


@dataclass
class PixelBudget:
    """Bytes that the photographs of one scene may keep between them; asked by several threads."""

    left: int
    _lock: OwnLock = field(default_factory=OwnLock, init=False, repr=False, compare=False)

    def take(self, size: int) -> bool:
        """Whether ``size`` more bytes may be kept; they then count."""
        with self._lock:
            if size > self.left:
                return False
            self.left -= size
            return True


@dataclass
class Photograph:
    """An image file at a chosen size, with its mask as alpha, undistorted where its lens needs it; call it for the
    pixels, which are decoded once, and kept while ``budget`` lasts. Several threads may call it.

    Undistorted pixels are asked of ``keeper``, by ``name``, before they are made."""

    path: Path
    width: int
    height: int
    budget: PixelBudget | None = None
    mask: MaskFile | None = None
    undistortion: Undistortion | None = None
    name: str = ""
    keeper: Keeper | None = None
    pixels: UInt8[np.ndarray, "H W C"] | None = field(default=None, init=False, repr=False)
    _lock: OwnLock = field(default_factory=OwnLock, init=False, repr=False, compare=False)

    def __call__(self) -> UInt8[np.ndarray, "H W C"]:
        """The pixels, display-referred sRGB, three channels or four with straight alpha; not to be written to.

        Raises:
            SceneError: the file is damaged or gone.
        """
        if self.pixels is not None:
            return self.pixels
        with self._lock:  # whoever comes second waits, and finds what the first one has decoded
            if self.pixels is not None:
                return self.pixels
            pixels = self._decoded()
            if self.budget is None or self.budget.take(pixels.nbytes):
                self.pixels = pixels
            return pixels

    def as_taken(self) -> Image.Image:
        """In the file's own size and lens, with its mask; decoded now and not kept. Raises SceneError."""
        colors = decoded(self.path)
        return colors if self.mask is None else self.mask.laid_over(colors)

    def mark(self) -> str:
        """What tells the content of its files from another without decoding them."""
        mask = None if self.mask is None else self.mask.path
        return mark_of(self.path, *([] if mask is None else [mask]))

    def _decoded(self) -> UInt8[np.ndarray, "H W C"]:
        if self.undistortion is None or self.keeper is None:
            return self._made()
        known = made_of(self.path, self.mask, self.undistortion)
        if known is None:  # it cannot be read: decoding says why
            return self._made()
        kept = self.keeper.find(self.name, known)
        if kept is not None and kept.shape[:2] == (self.height, self.width):
            return kept
        pixels = self._made()
        if made_of(self.path, self.mask, self.undistortion) == known:  # else it was changed meanwhile
            self.keeper.keep(self.name, known, pixels)
        return pixels

    def _made(self) -> UInt8[np.ndarray, "H W C"]:
        colors = self.as_taken()
        taken = self.undistortion.photograph if self.undistortion else self
        if colors.size != (taken.width, taken.height):
            # Pillow premultiplies RGBA by itself around every filter but NEAREST.
            colors = colors.resize((taken.width, taken.height), Image.Resampling.LANCZOS)
        pixels = np.array(colors)
        return self.undistortion(pixels) if self.undistortion else pixels
