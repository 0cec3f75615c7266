"""The colours of a photograph between its pixels: interpolating cubic splines.

Unser, Splines: A Perfect Fit for Signal and Image Processing, 1999. They keep finer detail than bilinear or
Catmull-Rom weights (docs/experiments/lenses.md), and give the photograph itself back at its own pixels. Colours are
premultiplied by alpha meanwhile, so that what is hidden under transparent pixels does not bleed.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, UInt8

POINTS_AT_ONCE = 1 << 17
"""Rows are worked off in strips of so many pixels: the coordinates and colours of a strip stay within the cache."""

BORDER = "mirror"
"""How SciPy goes on beyond the outermost pixels, whose centres lie half a pixel inside of the photograph."""


def resampled(
    pixels: UInt8[np.ndarray, "H W C"],
    places: Callable[[int, int], Sequence[Float[np.ndarray, "R V"]]],
    width: int,
    height: int,
) -> UInt8[np.ndarray, "U V C"]:
    """A picture of ``width`` by ``height`` whose pixels take the photograph's colours at places in it.

    ``places(first, last)`` are those of the rows from ``first`` to before ``last``: x and y in pixels, whose centres
    lie at .5. Three channels, or four with straight alpha.
    """
    from scipy import ndimage  # 30 MB that no other photograph wants

    planes = [ndimage.spline_filter(plane, order=3, mode=BORDER, output=np.float32) for plane in _premultiplied(pixels)]
    picture = np.empty((height, width, pixels.shape[2]), dtype=np.uint8)
    rows = max(1, POINTS_AT_ONCE // width)
    for first in range(0, height, rows):
        last = min(first + rows, height)
        x, y = places(first, last)
        at = [y - 0.5, x - 0.5]  # SciPy counts from the centre of the first pixel
        colors = [ndimage.map_coordinates(plane, at, order=3, mode=BORDER, prefilter=False) for plane in planes]
        picture[first:last] = _straight(np.stack(colors, -1))
    return picture


def _premultiplied(pixels: UInt8[np.ndarray, "H W C"]) -> list[Float[np.ndarray, "H W"]]:
    """Each channel, 0 to 255; colours times alpha."""
    planes = [plane.astype(np.float32) for plane in np.moveaxis(pixels, -1, 0)]
    if len(planes) == 3:
        return planes
    return [*(plane * planes[3] / 255 for plane in planes[:3]), planes[3]]


def _straight(colors: Float[np.ndarray, "R V C"]) -> UInt8[np.ndarray, "R V C"]:
    """The way back, rounded to 8 bits."""
    if colors.shape[2] == 4:
        alpha = colors[..., 3:]
        visible = alpha >= 0.5  # the rest is rounded to zero
        colors[..., :3] = np.where(visible, colors[..., :3] * 255 / np.maximum(alpha, 0.5), 0)
    return np.clip(np.rint(colors), 0, 255).astype(np.uint8)
