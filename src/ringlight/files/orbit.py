"""An orbit round the subject: a level circle, or as much of it as was photographed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.data.poses import MAX_COORDINATE
from ringlight.errors import RecipeError
from ringlight.files.camera_paths import SMALLEST_LENGTH, Array, posed, position_of, rotation_of

FALLBACK_WEIGHT = 1e-6
"""Pulls the look-at point to a place before the cameras; decides only where their axes are parallel."""

WIDEST_GAP = 75.0
"""Degrees round the subject between two neighbouring photographs that an orbit crosses: no frame is farther than half
of it from one of them. Beyond that nothing tells what a model shows."""

NARROWEST_ARC = 15.0
"""Degrees that an orbit swings at least, for a film of a single photograph that moves."""

OVERHEAD = 0.1
"""Cameras that stand nearer to the axis than this share of the others' distance are on no side of the subject."""

LEVEL_PRIOR = 1e-6
"""Weight of the mean up axis beside the level of the cameras; decides only where these look almost one way."""

MOST_ROLL = 0.05
"""Mean square of a level camera's right side along the up axis: 13 degrees of roll."""

LEAST_AGREEMENT = 0.5
"""Cosine between that axis and the mean up axis: cameras tilt by up to 60 degrees."""

STEEPEST = 0.01
"""Radius over height of the steepest orbit."""

MARGIN = 0.03
"""Share of a picture's side that stays free round the subject."""

SHOWN_DIGITS = 4
"""Of an orbit's radius; of its other lengths as many places."""

LEFT_OUT = 0.005
"""Share of points on each side that a picture may cut: floaters."""


@dataclass(frozen=True)
class OrbitWish:
    """What is asked of an orbit, in world units and degrees; None is as photographed.

    Raises RecipeError for what is no orbit.
    """

    center: tuple[float, float, float] | None = None
    radius: float | None = None
    height: float | None = None
    arc: float | None = None

    def __post_init__(self) -> None:
        if self.center is not None and not all(abs(number) <= MAX_COORDINATE for number in self.center):
            raise RecipeError(f"--center is {self.center}: give x, y and z in world units, up to {MAX_COORDINATE:g}")
        if self.radius is not None and not 0 < self.radius <= MAX_COORDINATE:
            raise RecipeError(f"--radius is {self.radius}: give world units above zero, up to {MAX_COORDINATE:g}")
        if self.height is not None and not abs(self.height) <= MAX_COORDINATE:
            raise RecipeError(f"--height is {self.height}: give world units up to {MAX_COORDINATE:g}")
        if self.arc is not None and not 0 < self.arc <= 360:
            raise RecipeError(f"--arc is {self.arc}: give degrees above 0, at most 360")


@dataclass(frozen=True)
class Orbit:
    """A level circle about ``center`` + ``height`` ``up``, world units, or the ``arc`` of it, degrees, whose middle
    lies towards ``middle``; ``like`` has the intrinsics."""

    center: Array
    up: Array
    middle: Array
    radius: float
    height: float
    arc: float
    like: Camera

    def cameras(self, frames: int) -> list[Camera]:
        """Evenly round the circle; along an arc from its middle to one end, to the other and back, so that films
        repeat without a jump."""
        side = np.cross(self.up, self.middle)
        turns = 2 * np.pi * np.arange(frames) / frames
        angles = turns if self.arc >= 360 else np.radians(self.arc / 2) * np.sin(turns)
        hub = self.center + self.height * self.up
        spokes = (math.cos(angle) * self.middle + math.sin(angle) * side for angle in angles)
        return [_looking_at(hub + self.radius * spoke, self.center, self.up, self.like) for spoke in spokes]

    def words(self) -> str:
        """Its numbers, by the flags that change them."""
        places = max(SHOWN_DIGITS - 1 - math.floor(math.log10(self.radius)), 0)
        # Without exponents, which the parser would take for flags behind a minus; zero is added to lose one of its own.
        lengths = (*self.center, self.radius, self.height)
        x, y, z, radius, height = (f"{round(float(number), places) + 0.0:.{places}f}" for number in lengths)
        return f"--center {x} {y} {z} --radius {radius} --height {height} --arc {self.arc:.4g}"


def orbit_of(cameras: Sequence[Camera], wish: OrbitWish = OrbitWish()) -> Orbit:
    """The orbit that suits ``cameras`` (one or more), or as it was wished.

    Up is what the cameras' pictures are level to; the centre is the point nearest to all optical axes; radius and
    height are the cameras' medians; the intrinsics are those of the camera with the median field of view. The circle
    is whole where photographs were taken all round, with gaps of at most :data:`WIDEST_GAP`; then it begins at the
    first camera. Else it is the arc with most of them.
    """
    positions = np.stack([position_of(camera) for camera in cameras])
    up = up_of(cameras)
    if wish.center is None:
        center = _nearest_to_axes(positions, np.stack([rotation_of(camera)[2] for camera in cameras]))
    else:
        center = np.array(wish.center, dtype=np.float64)
    heights = (positions - center) @ up
    spokes = positions - center - heights[:, None] * up
    size = max(float(np.linalg.norm(positions - center, axis=1).max()), SMALLEST_LENGTH)
    # A camera right above would look along the up axis, which leaves its roll undefined.
    radius = max(float(np.median(np.linalg.norm(spokes, axis=1))), STEEPEST * size)
    start = _unit_or(spokes[0], _any_perpendicular(up), SMALLEST_LENGTH * size)
    middle, arc = _photographed(_azimuths(spokes, start, np.cross(up, start)))
    like = sorted(cameras, key=lambda camera: camera.width / camera.focal[0])[len(cameras) // 2]
    radius = radius if wish.radius is None else wish.radius
    height = float(np.median(heights)) if wish.height is None else wish.height
    if radius < STEEPEST * abs(height):
        raise RecipeError(
            f"an orbit of radius {radius:g} at height {height:g} looks straight down; give a larger --radius"
        )
    towards = math.cos(middle) * start + math.sin(middle) * np.cross(up, start)
    return Orbit(center, up, towards, radius, height, arc if wish.arc is None else wish.arc, like)


def showing_whole(cameras: Sequence[Camera], points: Float[Tensor, "N 3"]) -> float:
    """The factor on the focal lengths, at most 1, with which no camera cuts these points at its picture's edge."""
    factor = 1.0
    for camera in cameras:
        matrix = camera.world_to_camera.to(points)
        seen = points @ matrix[:3, :3].T + matrix[:3, 3]
        seen = seen[seen[:, 2] > 0]
        if len(seen) == 0:
            continue
        for axis, side in enumerate((camera.width, camera.height)):
            offsets = camera.focal[axis] * (seen[:, axis] / seen[:, 2]).double().numpy()
            below, above = np.quantile(offsets, (LEFT_OUT, 1 - LEFT_OUT))
            room = camera.center[axis] - MARGIN * side, side * (1 - MARGIN) - camera.center[axis]
            needed = (-below / max(room[0], 1.0), above / max(room[1], 1.0))
            factor = min(factor, 1 / max(*needed, 1.0))
    return float(factor)


def _azimuths(spokes: Array, start: Array, side: Array) -> Array:
    """Angles of the cameras round the axis, radians from ``start``, without those that stand on no side."""
    lengths = np.linalg.norm(spokes, axis=1)
    beside = lengths > OVERHEAD * np.median(lengths)
    return np.arctan2(spokes[beside] @ side, spokes[beside] @ start)


def _photographed(azimuths: Array) -> tuple[float, float]:
    """Middle, radians, and width, degrees, of the arc with most cameras and no gap above :data:`WIDEST_GAP`."""
    if len(azimuths) == 0:
        return 0.0, 360.0
    angles = np.sort(azimuths)
    gaps = np.diff(angles, append=angles[0] + 2 * np.pi)
    breaks = np.flatnonzero(gaps > math.radians(WIDEST_GAP))
    if len(breaks) == 0:
        return 0.0, 360.0
    # Each arc begins behind a gap and ends at the next one, perhaps beyond the full turn.
    unrolled = np.concatenate([angles, angles + 2 * np.pi])
    ends = [*breaks[1:], breaks[0] + len(angles)]
    first, last = max(zip(breaks + 1, ends, strict=True), key=lambda arc: int(arc[1] - arc[0]))
    begin, end = float(unrolled[first]), float(unrolled[last])
    return (begin + end) / 2, max(math.degrees(end - begin), NARROWEST_ARC)


def up_of(cameras: Sequence[Camera]) -> Array:
    """The axis to which the cameras' right sides are perpendicular, as level cameras' are; where they are not, the mean
    of the cameras' own up axes, which tilts where all look down from one side; where these cancel, the direction in
    which the positions vary least."""
    rotations = np.stack([rotation_of(camera) for camera in cameras])
    positions = np.stack([position_of(camera) for camera in cameras])
    flattest = np.linalg.svd(positions - positions.mean(0), full_matrices=True)[2][-1]
    mean = _unit_or(-rotations[:, 1].mean(0), flattest, 0.1)
    rights = rotations[:, 0]
    spread = rights.T @ rights / len(rights) + LEVEL_PRIOR * (np.eye(3) - np.outer(mean, mean))
    shares, axes = np.linalg.eigh(spread)
    level = axes[:, 0] * np.sign(axes[:, 0] @ mean)
    return level if shares[0] < MOST_ROLL and level @ mean > LEAST_AGREEMENT else mean


def _nearest_to_axes(positions: Array, forwards: Array) -> Array:
    """The point with the least sum of squared distances to the optical axes."""
    across = np.eye(3) - forwards[:, :, None] * forwards[:, None, :]
    spread = max(float(np.linalg.norm(positions - positions.mean(0), axis=1).max()), 1.0)
    fallback = positions.mean(0) + spread * forwards.mean(0)
    weight = FALLBACK_WEIGHT * len(positions)
    target = np.einsum("nij,nj->i", across, positions) + weight * fallback
    return np.linalg.solve(across.sum(0) + weight * np.eye(3), target)


def _unit_or(vector: Array, otherwise: Array, shortest: float) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > shortest else otherwise


def _any_perpendicular(axis: Array) -> Array:
    other = np.eye(3)[np.abs(axis).argmin()]
    return _unit_or(np.cross(axis, other), other, 0.0)


def _looking_at(position: Array, target: Array, up: Array, like: Camera) -> Camera:
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return posed(np.stack([right, np.cross(forward, right), forward]), position, like)
