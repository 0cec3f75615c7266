"""A mask in a file of its own: how it becomes the alpha of its photograph."""

from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageChops

from ringlight.data.deep_images import OPAQUE
from ringlight.data.image_files import decoded, read_header
from ringlight.data.intrinsics import is_rescaled
from ringlight.errors import SceneError


@dataclass(frozen=True)
class MaskFile:
    """Where the mask lies; without a ``path`` all of the photograph is kept."""

    path: Path | None
    is_inverted: bool = False

    def refuse_other_size(self, width: int, height: int, photograph: str) -> None:
        """Raise SceneError where the mask cannot be read, or is none of a photograph of that size, in pixels."""
        if self.path is None:
            return
        header = read_header(self.path)
        if not is_rescaled((header.width, header.height), (width, height)):
            raise SceneError(
                f"{self.path}: the mask has {header.width}x{header.height} pixels and its photograph {photograph} "
                f"{width}x{height}; make the mask from the photograph as it is, or give --masks none"
            )

    def laid_over(self, photograph: Image.Image) -> Image.Image:
        """The photograph, RGB or RGBA, with the mask as alpha; what its own alpha hides stays hidden.

        Raises:
            SceneError: the mask is damaged or gone.
        """
        alpha = self.alpha(photograph.size)
        if photograph.mode == "RGBA":
            alpha = ImageChops.darker(alpha, photograph.getchannel("A"))
        with_alpha = photograph.convert("RGB")
        with_alpha.putalpha(alpha)
        return with_alpha

    def alpha(self, size: tuple[int, int]) -> Image.Image:
        """What is kept, 0 to 255, at this (width, height)."""
        if self.path is None:
            return Image.new("L", size, OPAQUE)
        kept = _kept(decoded(self.path, keeps_labels=True))
        if self.is_inverted:
            kept = ImageChops.invert(kept)
        return kept if kept.size == size else kept.resize(size, Image.Resampling.BILINEAR)


def _kept(mask: Image.Image) -> Image.Image:
    """The brightness, or the alpha of a mask that has some. Masks of 0 and 1, as labels are often stored, count as
    black and white."""
    if mask.mode == "RGBA" and mask.getchannel("A").getextrema() != (OPAQUE, OPAQUE):
        return mask.getchannel("A")
    grey = mask.convert("L")
    return grey.point(lambda value: OPAQUE * min(value, 1)) if grey.getextrema()[1] == 1 else grey
