"""A smooth flight through key frames, each passed at its time.

Places and targets follow cubic Hermite curves whose velocity at a stop is that of the parabola through it and its two
neighbours, so that it does not jump, whatever the times are. Rotations follow a spline whose angular velocity and
acceleration do not jump (``scipy.spatial.transform.RotationSpline``). Where all stops look at points, so does the
flight, and what they look at stays in the middle.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ringlight.core.camera import Camera
from ringlight.errors import SceneError
from ringlight.files.camera_paths import posed
from ringlight.files.key_frames import KeyFrames, Stop

Array = NDArray[np.float64]

AROUND = 2
"""Stops before the first and behind the last that a closed flight looks at, which are those of its other end."""

STEEPEST = 1e-4
"""Sine of the angle between up and the axis below which a camera's roll is undefined."""


def frame_times(flight: KeyFrames, frames: int | None, fps: float, most: int) -> Float[np.ndarray, "F"]:
    """Seconds of the frames: at even distances from the first stop to the last, about 1 / ``fps`` apart, or so many. No
    frame need lie on a stop between. A closed flight has no frame twice. Raises SceneError for more than ``most``."""
    if frames is None:
        if flight.seconds * fps > most + 1:  # refused before it is rounded: infinity has no integer
            raise SceneError(
                f"the flight has far more frames than fit; give at most {most:,}, by fewer --frames or --fps"
            )
        frames = 1 if len(flight.stops) == 1 else max(round(flight.seconds * fps) + (not flight.closed), 1)
    if frames > most:
        raise SceneError(f"the flight has {frames:,} frames; give at most {most:,}, by fewer --frames or --fps")
    return np.linspace(0.0, flight.seconds, frames, endpoint=not flight.closed)


def flown(flight: KeyFrames, times: Float[np.ndarray, "F"]) -> list[Camera]:
    """A camera for each time, of the flight's size. Raises SceneError where one looks straight up or down."""
    stops, at = _around(flight)
    places = _curve(at, np.stack([stop.position for stop in stops]))(times)
    focals = np.exp(_curve(at, np.log([[stop.focal] for stop in stops]))(times))[:, 0]
    rotations = _rotations(flight, stops, at, times, places)
    center, size = (flight.width / 2, flight.height / 2), (flight.width, flight.height)
    return [
        posed(rotation, place, Camera(torch.eye(4), (focal, focal), center, *size))
        for place, rotation, focal in zip(places, rotations, focals.tolist(), strict=True)
    ]


def _around(flight: KeyFrames) -> tuple[list[Stop], Array]:
    """The stops with their times; of a closed flight also some of the turn before and behind."""
    stops, count = list(flight.stops), len(flight.stops)
    if not flight.closed:
        return stops, np.array([stop.time for stop in stops])
    indices = range(-AROUND, count + 1 + AROUND)
    times = [stops[index % count].time + flight.seconds * (index // count) for index in indices]
    return [stops[index % count] for index in indices], np.array(times)


def _curve(times: Array, values: Array) -> Callable[[Array], Array]:
    """Through ``values`` [n c] at ``times``."""
    if len(times) == 1:
        return lambda asked: np.repeat(values, len(asked), 0)
    gaps = np.diff(times)[:, None]
    slopes = np.diff(values, axis=0) / gaps
    inner = (slopes[:-1] * gaps[1:] + slopes[1:] * gaps[:-1]) / (gaps[1:] + gaps[:-1])
    return CubicHermiteSpline(times, values, np.concatenate([slopes[:1], inner, slopes[-1:]]))


def _rotations(flight: KeyFrames, stops: Sequence[Stop], at: Array, times: Array, places: Array) -> list[Array]:
    """World to camera [3 3] for each of ``times``."""
    if all(stop.target is not None for stop in stops):
        targets = _curve(at, np.stack([stop.target for stop in stops if stop.target is not None]))(times)
        pairs = zip(targets, places, times, strict=True)
        return [_looking(target - place, flight.up, time) for target, place, time in pairs]
    known = [_of_stop(stop, flight.up) for stop in stops]
    if len(known) == 1:
        return known * len(times)
    spline = RotationSpline(at, Rotation.from_matrix(np.stack(known).transpose(0, 2, 1)))
    return list(spline(times).as_matrix().transpose(0, 2, 1))


def _of_stop(stop: Stop, up: Array) -> Array:
    if stop.rotation is not None:
        return stop.rotation
    assert stop.target is not None  # a stop has one of the two
    return _looking(stop.target - stop.position, up, stop.time)


def _looking(towards: Array, up: Array, time: float) -> Array:
    """Right, down and forward as rows; the camera is level."""
    length = float(np.linalg.norm(towards))
    forward = towards / max(length, np.finfo(np.float64).tiny)
    right = np.cross(forward, up)
    steepness = float(np.linalg.norm(right))
    if steepness < STEEPEST:
        raise SceneError(
            f"{time:.2f} seconds into the flight the camera looks straight up or down, or at its own place, which "
            "leaves its roll open; move that stop, or give its camera_to_world"
        )
    right /= steepness
    return np.stack([right, np.cross(forward, right), forward])
