"""How a lens bends rays: the distortion models of COLMAP and OpenCV, there and back, in float64.

Points are where rays cross the plane at distance one before a pinhole: (x / z, y / z). A bent point is where the lens
shows the same ray; times the focal length, plus the centre, it is a pixel.

Formulas: https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html (rational and tangential),
https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html, https://colmap.github.io/cameras.html.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial

from ringlight.core.computed_once import computed_once

FARTHEST = 20.0
"""Radius up to which rays are sought of a lens that is not by angle; that is 87 degrees from the axis."""

BEFORE_FOLD = 1 - 1e-6
"""Share of the radius of a fold up to which rays are sought: at a fold's end a divisor may be zero."""

TABLE = 4096
"""Radii between which the way back starts; Newton's steps do the rest."""

NEWTON_STEPS = 8
"""From a neighbour in the table five reach the last bit; near a fold each step only halves the error."""

TANGENTIAL_STEPS = 50
"""Each takes off a share of the error like the tangential coefficients, which are a hundredth at most in real lenses.
"""

FOUND = 1e-9
"""Greatest error of a point found on the way back: a hundred-thousandth of a pixel at a focal length of 10,000."""


@dataclass(frozen=True)
class Lens:
    """A lens by COLMAP's name of its ``model`` and its coefficients.

    ``radial`` scales a point by 1 + k1 q + k2 q^2 + ..., with q the square of its radius, over the same series of
    ``divisor``. A lens ``by_angle`` (fisheye) shows a ray at the angle to the axis, in radians, scaled alike, in place
    of at its tangent. ``tangential`` are p1 and p2.
    """

    model: str
    radial: tuple[float, ...] = ()
    divisor: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    by_angle: bool = False

    @property
    def is_straight(self) -> bool:
        """Whether it is a pinhole, exactly."""
        return not (self.by_angle or any((*self.radial, *self.divisor, *self.tangential)))

    @computed_once
    def fold(self) -> float:
        """The radius, or angle, from which on the lens shows rays farther out no farther out; infinite if nowhere."""
        scale, divisor = Polynomial([1, *self.radial]), Polynomial([1, *self.divisor])
        twice_q = Polynomial([0, 2])
        slope = (scale + twice_q * scale.deriv()) * divisor - twice_q * scale * divisor.deriv()
        roots = np.concatenate([slope.roots(), divisor.roots()])
        real = roots.real[(np.abs(roots.imag) <= 1e-12 * np.abs(roots)) & (roots.real > 0)]
        return math.sqrt(real.min()) if len(real) else math.inf

    def bent(self, points: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """Where the lens shows rays. Beyond :attr:`fold` that is where it shows other rays too."""
        return np.stack(self.bent_planes(points[..., 0], points[..., 1]), -1)

    def bent_planes(self, x: Float[np.ndarray, "*N"], y: Float[np.ndarray, "*N"]) -> list[Float[np.ndarray, "*N"]]:
        """As :meth:`bent`, x and y apart, which is several times as fast."""
        q = x * x + y * y
        if self.by_angle:
            radius = np.sqrt(q)
            angle = np.arctan(radius)
            # Near the axis an angle is its tangent, to the last bit.
            scale = np.divide(angle, radius, out=np.ones_like(radius), where=radius > 1e-8) * self._scale(angle * angle)
            return [x * scale, y * scale]
        scale = self._scale(q)
        if not any(self.tangential):
            return [x * scale, y * scale]
        p1, p2 = self.tangential
        twice_xy = 2 * x * y
        return [
            x * scale + p1 * twice_xy + p2 * (q + 2 * x * x),
            y * scale + p2 * twice_xy + p1 * (q + 2 * y * y),
        ]

    def straightened(self, bent: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
        """The rays that the lens shows there, on this side of :attr:`fold`; NaN where there are none."""
        points = self._straightened_radially(bent)
        if any(self.tangential):
            for _ in range(TANGENTIAL_STEPS):
                before, points = points, self._straightened_radially(bent - self._sideways(points))
                if (np.abs(points - before) <= FOUND / 10).all():
                    break
        missed = ~(np.abs(self.bent(points) - bent).max(-1) <= FOUND)  # also where it is NaN
        return np.where(missed[:, None], np.nan, points)

    def _scale(self, q: Float[np.ndarray, "*N"]) -> Float[np.ndarray, "*N"]:
        """What takes a radius to its bent radius, by its square."""
        scale = _series(q, self.radial)
        return scale / _series(q, self.divisor) if any(self.divisor) else scale

    def _sideways(self, points: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """What the tangential coefficients add."""
        return Lens(self.model, tangential=self.tangential).bent(points) - points

    def _straightened_radially(self, bent: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
        """As :meth:`straightened` without tangential coefficients, but wrong, not NaN, where there is no ray."""
        sought = np.sqrt(np.square(bent).sum(-1))
        last = min(self.fold * BEFORE_FOLD, math.pi / 2 if self.by_angle else FARTHEST)
        table = np.linspace(0, last, TABLE)
        found = np.interp(sought, table * self._scale(table**2), table)
        scale, divisor = Polynomial([1, *self.radial]), Polynomial([1, *self.divisor])
        for _ in range(NEWTON_STEPS):
            q = found**2
            over, under = scale(q), divisor(q)
            slope = (over + 2 * q * scale.deriv()(q)) / under - 2 * q * over * divisor.deriv()(q) / under**2
            step = (found * over / under - sought) / np.where(slope == 0, 1, slope)
            found = np.clip(found - step, 0, last)
        radius = np.tan(found) if self.by_angle else found
        return bent * np.divide(radius, sought, out=np.ones_like(sought), where=sought > 1e-12)[:, None]


def _series(q: Float[np.ndarray, "*N"], coefficients: tuple[float, ...]) -> Float[np.ndarray, "*N"]:
    """1 + k1 q + k2 q^2 + ..."""
    used = max((index + 1 for index, value in enumerate(coefficients) if value), default=0)
    total = np.zeros_like(q)
    for value in reversed(coefficients[:used]):
        total += value
        total *= q
    total += 1
    return total


PINHOLE = Lens("PINHOLE")
"""Bends nothing."""
