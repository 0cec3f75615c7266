"""Focal lengths and principal point, in the pixels of the image they belong to, and the lens before them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ringlight.data.lens import PINHOLE, Lens
from ringlight.errors import SceneError

MAX_PIXELS = 1e8
"""Largest focal length, offset or side believed, in pixels; anything beyond is a damaged number."""

MAX_COEFFICIENT = 1e6
"""Largest coefficient of a lens believed; those of real lenses are below a hundred."""

LEAST_COEFFICIENT = 1e-15
"""Smaller ones bend nothing, and roots of a polynomial that they lead are beyond the range of float64."""

COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
"""OpenCV's names."""

MOST_RESIZED = 64
"""Times that a photograph may be smaller or larger than its camera: beyond that it is another picture, a thumbnail or a
placeholder."""


@dataclass(frozen=True)
class Intrinsics:
    """A camera without a pose: ``focal`` and ``center`` (x, y) in pixels of a ``width`` by ``height`` grid."""

    focal: tuple[float, float]
    center: tuple[float, float]
    width: int
    height: int
    lens: Lens = PINHOLE

    def resized(self, width: int, height: int) -> "Intrinsics":
        """The same camera in the pixels of another grid."""
        x, y = width / self.width, height / self.height
        focal, center = (self.focal[0] * x, self.focal[1] * y), (self.center[0] * x, self.center[1] * y)
        return Intrinsics(focal, center, width, height, self.lens)

    def on_image(self, width: int, height: int, where: str) -> "Intrinsics":
        """The same camera in the pixels of the image at hand, which may have been resized since.

        Raises:
            SceneError: one is upright and the other lies on its side (an image that was turned), or their shapes differ
                by more than whole pixels explain (an image that was cropped or stretched).
        """
        if (width, height) == (self.width, self.height):
            return self
        if (width - height) * (self.width - self.height) < 0:
            raise SceneError(
                f"{where} has an image of {width}x{height} pixels and a camera of {self.width}x{self.height}, turned "
                "by a quarter; store the image the way it was when the poses were found"
            )
        if not is_rescaled((width, height), (self.width, self.height)):
            raise SceneError(
                f"{where} has an image of {width}x{height} pixels and a camera of {self.width}x{self.height}, which is "
                "no resized form of it; use the photographs that the poses were found with, not cropped or stretched "
                "ones"
            )
        return self.resized(width, height)


def is_rescaled(first: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether one of two sizes, (width, height) in pixels, is the other divided by a factor and rounded."""
    fewest, most = _factors(first, other)
    return fewest <= min(most, MOST_RESIZED)


def _factors(image: tuple[int, int], camera: tuple[int, int]) -> tuple[float, float]:
    """Between which factors the larger grid was shrunk to the smaller one, whose sides were rounded up or down; the
    first is above the second where no factor explains both sides."""
    large, small = (image, camera) if image[0] * image[1] >= camera[0] * camera[1] else (camera, image)
    fewest = max(big / (side + 1) for big, side in zip(large, small, strict=True))
    most = min(big / (side - 1) if side > 1 else math.inf for big, side in zip(large, small, strict=True))
    return fewest, most


def checked_intrinsics(
    focal: tuple[float, float],
    center: tuple[float, float],
    size: tuple[float, float],
    where: str,
    lens: Lens = PINHOLE,
) -> Intrinsics:
    """Intrinsics whose numbers are finite and believable; ``size`` is (width, height).

    Raises:
        SceneError: a focal length or side that is not positive, a number that is not finite or absurdly large.
    """
    for what, values, lowest in (
        ("a focal length", focal, 1e-3),
        ("an image size", size, 1),
        ("a centre", center, None),
    ):
        for value in values:
            low = -MAX_PIXELS if lowest is None else lowest
            if not (math.isfinite(value) and low <= value <= MAX_PIXELS):
                raise SceneError(f"{where} has {what} of {value:g} pixels; correct it or export the cameras again")
    return Intrinsics(focal, center, round(size[0]), round(size[1]), lens)


def checked_lens(model: str, by_angle: bool, coefficients: Mapping[str, float], where: str) -> Lens:
    """A lens of OpenCV's coefficients k1 to k6, p1 and p2, those that are absent being zero; of a lens ``by_angle``
    (fisheye) k1 to k4 alone.

    Raises:
        SceneError: a coefficient that is not finite or absurdly large.
    """
    for name, value in coefficients.items():
        if not abs(value) <= MAX_COEFFICIENT:
            raise SceneError(f"{where} has a lens with {name} = {value:g}; correct it or export the cameras again")
    given = {name: value for name, value in coefficients.items() if abs(value) >= LEAST_COEFFICIENT}
    k1, k2, k3, k4, k5, k6, p1, p2 = (given.get(name, 0.0) for name in COEFFICIENTS)
    if by_angle:
        return Lens(model, (k1, k2, k3, k4), by_angle=True)
    return Lens(model, (k1, k2, k3), (k4, k5, k6), (p1, p2))
