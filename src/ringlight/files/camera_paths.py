"""Where a film's camera goes: round the subject, or through given cameras."""

import math
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

FALLBACK_WEIGHT = 1e-6
"""Pulls the look-at point to a place before the cameras; decides only where their axes are parallel."""

CENTRIPETAL = 0.5
"""Exponent of the knots' distances: no cusps and no loops within a segment (Yuksel et al. 2011)."""


def orbit(cameras: Sequence[Camera], frames: int) -> list[Camera]:
    """A level circle round the subject of ``cameras`` (one or more), beginning nearest the first.

    Up is the cameras' average up; the centre is the point nearest to all optical axes; radius and height are the
    cameras' medians; the intrinsics are those of the camera with the median field of view.
    """
    positions = np.stack([_position(camera) for camera in cameras])
    forwards = np.stack([_rotation(camera)[2] for camera in cameras])
    up = _average_up(cameras, positions)
    center = _nearest_to_axes(positions, forwards)
    heights = (positions - center) @ up
    spokes = positions - center - heights[:, None] * up
    size = max(float(np.linalg.norm(positions - center, axis=1).max()), SMALLEST_LENGTH)
    # A camera right above would look along the up axis, which leaves its roll undefined.
    radius = max(float(np.median(np.linalg.norm(spokes, axis=1))), 0.01 * size)
    height = float(np.median(heights))
    start = _unit_or(spokes[0], _any_perpendicular(up), SMALLEST_LENGTH * size)
    side = np.cross(up, start)
    like = sorted(cameras, key=lambda camera: camera.width / camera.focal[0])[len(cameras) // 2]
    angles = 2 * np.pi * np.arange(frames) / frames
    return [
        _looking_at(center + height * up + radius * (math.cos(a) * start + math.sin(a) * side), center, up, like)
        for a in angles
    ]


def interpolated(cameras: Sequence[Camera], frames: int) -> list[Camera]:
    """A smooth flight through ``cameras`` (one or more), from the first to the nearest not yet visited, and so on.

    Positions follow a centripetal Catmull-Rom curve, rotations and intrinsics are interpolated from camera to camera
    (rotations by slerp). Every camera is one of the frames, frames are spread by distance; where there are fewer
    frames than cameras, some cameras are left out. The picture size is the first camera's.
    """
    first = cameras[0]
    knots = [camera.resized(first.width, first.height) for camera in cameras]
    knots = [knots[i] for i in _tour(np.stack([_position(camera) for camera in knots]))]
    if frames <= len(knots):
        return [knots[i] for i in np.linspace(0, len(knots) - 1, frames).round().astype(int)]
    if len(knots) == 1:
        return knots * frames
    positions = np.stack([_position(camera) for camera in knots])
    counts = _shares(np.linalg.norm(np.diff(positions, axis=0), axis=1), frames - 1)
    path = [
        _between(knots, positions, segment, step / count)
        for segment, count in enumerate(counts)
        for step in range(count)
    ]
    return [*path, knots[-1]]


def _rotation(camera: Camera) -> Array:
    return camera.world_to_camera[:3, :3].double().numpy()


def _position(camera: Camera) -> Array:
    return camera.position.double().numpy()


def _average_up(cameras: Sequence[Camera], positions: Array) -> Array:
    """Mean of the cameras' up axes; where they cancel, the direction in which the positions vary least."""
    mean = np.mean([-_rotation(camera)[1] for camera in cameras], axis=0)
    flattest = np.linalg.svd(positions - positions.mean(0), full_matrices=True)[2][-1]
    return _unit_or(mean, flattest, 0.1)


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
    return _posed(np.stack([right, np.cross(forward, right), forward]), position, like)


def _posed(rotation: Array, position: Array, like: Camera) -> Camera:
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
    rotations = Rotation.from_matrix(np.stack([_rotation(before).T, _rotation(after).T]))
    rotation = Slerp([0.0, 1.0], rotations)(t).as_matrix().T
    like = replace(
        before,
        focal=_mixed(before.focal, after.focal, t),
        center=_mixed(before.center, after.center, t),
    )
    return _posed(rotation, _catmull_rom(_four_points(positions, segment), t), like)


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
