"""Which pinhole stands in for a lens, and the photograph as that pinhole would have taken it.

The pinhole is that of COLMAP's image_undistorter with its default settings: focal lengths stay, and width and height
are as large as they can be without a pixel that the photograph does not show. So a picture has no blank border that a
loss or a measure would have to leave out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, UInt8

from ringlight.data.intrinsics import Intrinsics
from ringlight.data.lens import PINHOLE
from ringlight.data.resample import resampled
from ringlight.errors import SceneError

NEGLIGIBLE = 0.05
"""Pixels. Lenses that move no pixel farther are taken as pinholes: structure from motion finds points to half a pixel,
and resampling would cost more sharpness than it mends."""

SCALES = (0.2, 2.0)
"""COLMAP's bounds on the picture's width over the photograph's; the upper one ends where wide lenses stretch corners.
"""

OUTSIDE = 1.0
"""Pixels that a place may lie outside of the photograph: what rounding the picture's sides to whole pixels moves."""

MOST_ON_A_SIDE = 1 << 15
"""Pixels of a border whose rays are sought: all of them but in pictures that no kernel draws."""

CHECKED = 64
"""Places along each side of a picture at which its way to the photograph is checked."""

SAME_LENS = 64
"""Lenses whose pinholes are remembered: the photographs of a scene have one, or a few."""


@dataclass(frozen=True)
class Undistortion:
    """From the pixels of a photograph to the picture of a pinhole; ``photograph`` and ``pinhole`` differ in lens, size
    and centre. Both are at one scale: that at which the picture is wanted."""

    photograph: Intrinsics
    pinhole: Intrinsics

    def __call__(self, pixels: UInt8[np.ndarray, "H W C"]) -> UInt8[np.ndarray, "U V C"]:
        """The picture, of a photograph with three channels, or four with straight alpha."""
        return resampled(pixels, self.places, self.pinhole.width, self.pinhole.height)

    def places(self, first: int, last: int) -> list[Float[np.ndarray, "R V"]]:
        """Where in the photograph the pixels of the picture's rows ``first`` to before ``last`` lie: x and y in pixels,
        whose centres lie at .5."""
        pinhole, taken = self.pinhole, self.photograph
        x = (np.arange(pinhole.width) + (0.5 - pinhole.center[0])) / pinhole.focal[0]
        y = (np.arange(first, last) + (0.5 - pinhole.center[1])) / pinhole.focal[1]
        bent = taken.lens.bent_planes(*np.meshgrid(x, y))
        return [one * focal + center for one, focal, center in zip(bent, taken.focal, taken.center, strict=True)]

    def at(self, width: int, height: int) -> "Undistortion":
        """The same for a picture of that size, of a photograph that was resized as much."""
        x, y = width / self.pinhole.width, height / self.pinhole.height
        taken = self.photograph
        source = taken.resized(max(1, round(taken.width * x)), max(1, round(taken.height * y)))
        return Undistortion(source, self.pinhole.resized(width, height))


def undistortion_of(photograph: Intrinsics, where: str) -> Undistortion | None:
    """How to undistort the photographs of a lens; None for a pinhole, and for a lens that is one within
    :data:`NEGLIGIBLE`. ``where`` names file and camera.

    Raises:
        SceneError: no pinhole's picture can be made, because the lens shows rays twice or bends them too far.
    """
    if photograph.lens.is_straight or farthest_moved(photograph) <= NEGLIGIBLE:
        return None
    made = _undistortion(photograph)
    if made is None:
        raise SceneError(
            f"{where} has a lens ({photograph.lens.model}) that no pinhole can stand in for: its coefficients fold the "
            "picture over before its border, or its centre lies outside; find the cameras again, with the camera model "
            "OPENCV_FISHEYE for wide lenses"
        )
    return made


def undistortion_note(made: Sequence[Undistortion | None]) -> tuple[str, ...]:
    """What a reader should know of the photographs' lenses."""
    taken = {one.photograph for one in made if one is not None}
    if not taken:
        return ()
    models = ", ".join(sorted({one.lens.model for one in taken}))
    pixels = max(farthest_moved(one) for one in taken)
    return (f"lens: undistorted ({models}), which moved pixels by up to {pixels:.1f}; blank borders are cropped off",)


@lru_cache(maxsize=SAME_LENS)
def farthest_moved(photograph: Intrinsics) -> float:
    """How far the lens moves a ray at most, in pixels of the photograph; NaN or infinite for impossible ones."""
    grid = _grid(photograph.width, photograph.height)
    rays = (grid - photograph.center) / photograph.focal
    with np.errstate(all="ignore"):
        moved = (photograph.lens.bent(rays) - rays) * photograph.focal
        return float(np.sqrt(np.square(moved).sum(-1)).max())


@lru_cache(maxsize=SAME_LENS)
def _undistortion(photograph: Intrinsics) -> Undistortion | None:
    """None where no picture of the photograph is free of gaps and folds."""
    x, y = photograph.center
    if not (0 < x < photograph.width - 0.5 and 0 < y < photograph.height - 0.5):
        return None
    with np.errstate(all="ignore"):  # what is not finite fails the checks
        pinhole = _pinhole(photograph)
        made = pinhole and Undistortion(photograph, pinhole)
        return made if made and _shows_all(made) else None


def _pinhole(photograph: Intrinsics) -> Intrinsics | None:
    """None where the lens shows no ray at all at a side of the photograph. As in COLMAP a pixel there that shows none
    is left out, for a picture may do without corners that the lens folds over; but it stays where it is if that is
    because the rays are too far from the axis for any pinhole."""
    sides = []
    for side in _borders(photograph.width, photograph.height):
        bent = (side - photograph.center) / photograph.focal
        rays = photograph.lens.straightened(bent)
        found = np.isfinite(rays).all(-1)
        if not photograph.lens.by_angle and not found.any():
            return None
        rays = np.where(np.isfinite(rays), rays, bent) if photograph.lens.by_angle else rays[found]
        sides.append(rays * photograph.focal + photograph.center)
    left, right, top, bottom = sides
    width, x = _cropped(photograph.width, photograph.center[0], left[:, 0].max(), right[:, 0].min())
    height, y = _cropped(photograph.height, photograph.center[1], top[:, 1].max(), bottom[:, 1].min())
    return replace(photograph, center=(x, y), width=width, height=height, lens=PINHOLE)


def _cropped(side: int, center: float, first: float, last: float) -> tuple[int, float]:
    """The length of the picture's side in pixels and its centre, where pixels from ``first`` to ``last`` are shown all
    along the photograph's ``side``; the same share is kept on both sides of the centre."""
    kept = min((center - first) / center, (last - center) / (side - 0.5 - center))
    length = int(max(1.0, min(max(kept, SCALES[0]), SCALES[1]) * side))
    return length, center * length / side


def _shows_all(made: Undistortion) -> bool:
    """Whether all pixels of the picture lie in the photograph, in the same order in both."""
    pinhole, taken = made.pinhole, made.photograph
    grid = _grid(pinhole.width, pinhole.height)
    rays = (grid - pinhole.center) / pinhole.focal
    radius = np.sqrt(np.square(rays).sum(-1))
    places = taken.lens.bent(rays) * taken.focal + taken.center
    outside = np.maximum(-places, places - [taken.width, taken.height]).max()
    across, down = np.diff(places, axis=1)[:-1], np.diff(places, axis=0)[:, :-1]
    turns = across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]
    reach = np.arctan(radius) if taken.lens.by_angle else radius
    return bool(outside <= OUTSIDE and turns.min() > 0 and reach.max() < taken.lens.fold)


def _grid(width: int, height: int) -> Float[np.ndarray, "G G 2"]:
    """Places over a picture, borders too, in pixels."""
    x, y = np.linspace(0, width, CHECKED), np.linspace(0, height, CHECKED)
    return np.stack(np.meshgrid(x, y), -1)


def _borders(width: int, height: int) -> list[Float[np.ndarray, "B 2"]]:
    """The centres of the outermost pixels: left, right, top, bottom."""
    x, y = (np.linspace(0.5, side - 0.5, min(side, MOST_ON_A_SIDE)) for side in (width, height))
    upright = [np.stack([np.full_like(y, at), y], -1) for at in (0.5, width - 0.5)]
    return upright + [np.stack([x, np.full_like(x, at)], -1) for at in (0.5, height - 0.5)]
