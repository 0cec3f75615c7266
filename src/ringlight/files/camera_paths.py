"""Where a film's camera goes: through given cameras. Round the subject: see :mod:`ringlight.files.orbit`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ringlight.core.camera import Camera

Array = NDArray[np.float64]

SMALLEST_LENGTH = 1e-6
"""Share of the scene's size below which a length counts as zero."""

CENTRIPETAL = 0.5
"""Exponent of the knots' distances: no cusps and no loops within a segment (Yuksel et al. 2011)."""


def interpolated(cameras: Sequence[Camera], frames: int) -> list[Camera]:
    """A smooth flight through ``cameras`` (one or more), from the first to the nearest not yet visited, and so on.

    Positions follow a centripetal Catmull-Rom curve, rotations and intrinsics are interpolated from camera to camera
    (rotations by slerp). Every camera is one of the frames, frames are spread by distance; where there are fewer
    frames than cameras, some cameras are left out. The picture size is the first camera's.
    """
    positions = np.stack([position_of(camera) for camera in cameras])
    return flight([cameras[i] for i in _tour(positions)], frames)


def flight(cameras: Sequence[Camera], frames: int) -> list[Camera]:
    """As :func:`interpolated`, through ``cameras`` (one or more) in their own order."""
    first = cameras[0]
    knots = [camera.resized(first.width, first.height) for camera in cameras]
    if frames <= len(knots):
        return [knots[i] for i in np.linspace(0, len(knots) - 1, frames).round().astype(int)]
    if len(knots) == 1:
        return knots * frames
    positions = np.stack([position_of(camera) for camera in knots])
    counts = _shares(np.linalg.norm(np.diff(positions, axis=0), axis=1), frames - 1)
    path = [
        _between(knots, positions, segment, step / count)
        for segment, count in enumerate(counts)
        for step in range(count)
    ]
    return [*path, knots[-1]]


def rotation_of(camera: Camera) -> Array:
    """World to camera [3 3] in float64; its rows are right, down and forward in the world."""
    return camera.world_to_camera[:3, :3].double().numpy()


def position_of(camera: Camera) -> Array:
    """The optical centre [3], world units, in float64."""
    return camera.position.double().numpy()


def posed(rotation: Array, position: Array, like: Camera) -> Camera:
    """``like`` moved to ``position``; the rows of ``rotation`` are its right, down and forward."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ position
    return replace(like, world_to_camera=torch.from_numpy(matrix).float())


def _tour(positions: Array) -> list[int]:
    """Nearest neighbour first, from row 0."""
    order, left = [0], list(range(1, len(positions)))
    while left:
        distances = np.linalg.norm(positions[left] - positions[order[-1]], axis=1)
        order.append(left.pop(int(distances.argmin())))
    return order


def _shares(lengths: Array, frames: int) -> list[int]:
    """Frames for each segment, at least one, in proportion to its length; they add up to ``frames``."""
    spare = frames - len(lengths)
    total = float(lengths.sum())
    exact = spare * (lengths / total if total > 0 else np.full(len(lengths), 1 / len(lengths)))
    reached = np.floor(np.cumsum(exact) + 0.5).astype(int)
    reached[-1] = spare
    return [1 + int(n) for n in np.diff(reached, prepend=0)]


def _between(stops: Sequence[Camera], positions: Array, segment: int, t: float) -> Camera:
    """The camera at share ``t`` in [0, 1) of the way from stop ``segment`` to the next."""
    before, after = stops[segment], stops[segment + 1]
    if t == 0:
        return before
    rotations = Rotation.from_matrix(np.stack([rotation_of(before).T, rotation_of(after).T]))
    rotation = Slerp([0.0, 1.0], rotations)(t).as_matrix().T
    like = replace(
        before,
        focal=_mixed(before.focal, after.focal, t),
        center=_mixed(before.center, after.center, t),
    )
    return posed(rotation, _catmull_rom(_four_points(positions, segment), t), like)


def _mixed(a: tuple[float, float], b: tuple[float, float], t: float) -> tuple[float, float]:
    return (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))


def _four_points(positions: Array, segment: int) -> Array:
    """The segment's ends and their neighbours; beyond the path's ends the curve goes on straight."""
    a, b = positions[segment], positions[segment + 1]
    before = positions[segment - 1] if segment > 0 else 2 * a - b
    after = positions[segment + 2] if segment + 2 < len(positions) else 2 * b - a
    return np.stack([before, a, b, after])


def _catmull_rom(points: Array, t: float) -> Array:
    """The centripetal curve between the middle two points (Barry and Goldman 1988)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1) ** CENTRIPETAL
    # Points that coincide would divide by zero; any positive step gives the same curve there.
    steps = np.maximum(steps, max(float(steps.max()), 1.0) * SMALLEST_LENGTH)
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    u = knots[1] + t * (knots[2] - knots[1])
    level = points
    for degree in (1, 2):
        gaps = knots[degree:] - knots[:-degree]
        share = ((u - knots[: len(gaps)]) / gaps)[:, None]
        level = (1 - share) * level[:-1] + share * level[1:]
    share_last = (u - knots[1]) / (knots[2] - knots[1])
    return (1 - share_last) * level[0] + share_last * level[1]
