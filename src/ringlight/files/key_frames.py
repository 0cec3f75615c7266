"""Our own file of key frames: the stops of a flight, as a person or a viewer writes them (docs/render.md).

``ringlight_path`` 1, and ``stops``, each with ``position`` and ``look_at`` or with ``camera_to_world`` (4 x 4, camera
axes right, down, forward), and maybe ``time`` (seconds) and ``fov`` (degrees from the picture's bottom to its top). For
all stops: ``fov``, ``up``, ``width`` and ``height`` (pixels), ``fps``, ``seconds``, ``closed``.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ringlight.core.camera import Camera
from ringlight.core.kernel_limits import MAX_IMAGE_SIDE
from ringlight.data.json_fields import Fields, finite, matrix_of, read_object
from ringlight.data.poses import MAX_COORDINATE, OPENGL_TO_OPENCV, world_to_camera_from_opengl
from ringlight.errors import SceneError
from ringlight.files.atomic import write_text
from ringlight.files.frame_rate import FASTEST, SLOWEST
from ringlight.files.nerfstudio_path import NARROWEST, WIDEST

Array = NDArray[np.float64]

MARK, VERSION = "ringlight_path", 1

OF_FILE = (MARK, "stops", "fov", "up", "width", "height", "fps", "seconds", "closed")
OF_STOP = ("position", "look_at", "camera_to_world", "time", "fov")
"""All names that the format knows."""

MOST_STOPS = 10_000
"""More are no key frames; nerfstudio's camera_path.json holds every frame."""

LONGEST = 3600.0
"""Seconds of a flight."""

LEAST_GAP = 1e-6
"""Seconds from one stop to the next: no film tells nearer ones apart, and speeds between them overflow."""

PACE = 2.0
"""Seconds from one stop to the next where the file says no time."""

FPS = 30.0


@dataclass(frozen=True)
class Stop:
    """``rotation`` has the camera's right, down and forward in the world as its rows; None where it follows from
    ``target``, the point that it looks at. ``focal`` in pixels; ``time`` in seconds."""

    position: Array
    rotation: Array | None
    target: Array | None
    focal: float
    time: float


@dataclass(frozen=True)
class KeyFrames:
    """Stops in the order of their times, the first at 0; the flight takes ``seconds``, and where it is ``closed`` ends
    at the first stop. ``up`` is a unit direction of the world."""

    stops: tuple[Stop, ...]
    seconds: float
    closed: bool
    up: Array
    width: int
    height: int
    fps: float


def holds_key_frames(path: Path) -> bool:
    """Whether a JSON file is of this format. Raises SceneError for one that cannot be read."""
    return MARK in read_object(path)


def read_key_frames(path: Path, like: Camera | None, up: Array | None) -> KeyFrames:
    """The flight in a file. Where it does not say so, size and field of view are those of ``like``, and up is ``up``.

    Raises SceneError for a file that is damaged, of a later version, or that leaves open what nothing else says.
    """
    document = read_object(path)
    if document.get(MARK) != VERSION:
        raise SceneError(f"{path}: {MARK!r} is not {VERSION}; this version of ringlight reads no other format")
    _refuse_unknown(document, OF_FILE, str(path))
    entries = document.get("stops")
    if not isinstance(entries, list) or not 1 <= len(entries) <= MOST_STOPS:
        raise SceneError(f"{path}: holds no list of 1 to {MOST_STOPS:,} 'stops'; see docs/render.md")
    width, height = _side(document, "width", path, like), _side(document, "height", path, like)
    fps = _between(document, "fps", str(path), FPS, SLOWEST, FASTEST)
    closed = document.get("closed", False)
    if not isinstance(closed, bool):
        raise SceneError(f"{path}: 'closed' is not true or false; correct it")
    stops = [_stop(entry, f"{path}: stop {index}") for index, entry in enumerate(entries)]
    times, seconds = _times(document, stops, closed, path)
    usual = _focal_of(document, height, str(path))
    if usual is None and like is not None:
        usual = like.focal[1] * height / like.height
    found = []
    for index, (stop, time) in enumerate(zip(stops, times, strict=True)):
        where = f"{path}: stop {index}"
        focal = _focal_of(stop, height, where) or usual
        if focal is None:
            raise SceneError(f"{where} has no 'fov', and neither has the file; give degrees from bottom to top")
        found.append(_placed(stop, focal, time, where))
    return KeyFrames(tuple(found), seconds, closed, _up(document, up, found, path), width, height, fps)


def write_key_frames(path: Path, flight: KeyFrames) -> None:
    """A file of which :func:`read_key_frames` makes the same flight: each stop with its time. Raises OutputError."""
    document: dict[str, Any] = {MARK: VERSION, "width": flight.width, "height": flight.height, "fps": flight.fps}
    if flight.closed:
        document |= {"closed": True, "seconds": flight.seconds}
    if any(stop.target is not None for stop in flight.stops):
        document["up"] = flight.up.tolist()
    document["stops"] = [_written(stop, flight.height) for stop in flight.stops]
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def _written(stop: Stop, height: int) -> dict[str, Any]:
    fields: dict[str, Any] = {"time": stop.time, "fov": math.degrees(2 * math.atan(height / 2 / stop.focal))}
    if stop.rotation is None:
        assert stop.target is not None  # a stop has one of the two
        return fields | {"position": stop.position.tolist(), "look_at": stop.target.tolist()}
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = stop.rotation.T, stop.position
    return fields | {"camera_to_world": matrix.tolist()}


def _stop(entry: Any, where: str) -> Fields:
    if not isinstance(entry, dict):
        raise SceneError(f"{where} is not an object; give 'position' and 'look_at', or 'camera_to_world'")
    _refuse_unknown(entry, OF_STOP, where)
    named = {"position", "look_at"} & entry.keys()
    if ("camera_to_world" in entry) == bool(named) or len(named) == 1:
        raise SceneError(f"{where} needs 'position' and 'look_at', or 'camera_to_world' alone; correct it")
    return entry


def _refuse_unknown(fields: Fields, known: Sequence[str], where: str) -> None:
    """A misspelt name would be a setting that nobody obeys."""
    unknown = next((name for name in fields if name not in known), None)
    if unknown is not None:
        raise SceneError(f"{where}: {unknown!r} is none of {', '.join(known)}; correct it or leave it out")


def _placed(stop: Fields, focal: float, time: float, where: str) -> Stop:
    if "camera_to_world" not in stop:
        position, target = (_point(stop, name, where) for name in ("position", "look_at"))
        if np.linalg.norm(target - position) <= 1e-9 * max(1.0, float(np.abs(position).max())):
            raise SceneError(f"{where} looks at its own place; give another 'look_at'")
        return Stop(position, None, target, focal, time)
    matrix = matrix_of(stop, "camera_to_world", where, "give the camera's pose, row by row")
    flipped = matrix.copy()
    flipped[:3, :3] = matrix[:3, :3] @ OPENGL_TO_OPENCV
    return Stop(matrix[:3, 3], world_to_camera_from_opengl(flipped, where)[:3, :3], None, focal, time)


def _point(fields: Fields, name: str, where: str) -> Array:
    values = fields.get(name)
    if not isinstance(values, list) or len(values) != 3:
        raise SceneError(f"{where}: {name!r} is not three numbers; give x, y and z in world units")
    point = np.array([finite(value, f"{where}: {name!r}") for value in values])
    if np.abs(point).max() > MAX_COORDINATE:
        raise SceneError(f"{where}: {name!r} is farther than {MAX_COORDINATE:g} away; correct it")
    return point


def _times(document: Fields, stops: list[Fields], closed: bool, path: Path) -> tuple[list[float], float]:
    """Of the stops, from 0, and of the whole flight."""
    said = ["time" in stop for stop in stops]
    legs = len(stops) if closed else len(stops) - 1
    if not any(said):
        seconds = _between(document, "seconds", str(path), PACE * legs or 1 / FPS, 0.0, LONGEST)
        if seconds > LONGEST:
            took = f"take {seconds:g} seconds by {PACE:g} from each to the next; add 'seconds', up to {LONGEST:g}"
            raise SceneError(f"{path}: its {len(stops)} stops {took}")
        return [seconds * index / max(legs, 1) for index in range(len(stops))], seconds
    if "seconds" in document and not closed:
        raise SceneError(f"{path}: gives 'seconds' and the 'time' of its stops, which end the flight; leave one out")
    if not all(said):
        raise SceneError(f"{path}: stop {said.index(False)} has no 'time', and others have; give all or none")
    times = [finite(stop["time"], f"{path}: 'time' of stop {index}") for index, stop in enumerate(stops)]
    times = [time - times[0] for time in times]
    if any(later - earlier < LEAST_GAP for earlier, later in pairwise(times)):
        order = f"put them in order, each at least {LEAST_GAP:g} seconds later than the last"
        raise SceneError(f"{path}: the times of its stops do not rise; {order}")
    end = times[-1] + (times[-1] / (len(times) - 1) if closed and len(times) > 1 else 0.0) or 1 / FPS
    seconds = _between(document, "seconds", str(path), end, 0.0, LONGEST) if closed else end
    if seconds > LONGEST or (closed and seconds <= times[-1]):
        raise SceneError(f"{path}: takes {seconds:g} seconds; give up to {LONGEST:g}, and more than its last 'time'")
    return times, seconds


def _up(document: Fields, otherwise: Array | None, stops: list[Stop], path: Path) -> Array:
    if "up" in document:
        up = _point(document, "up", str(path))
        if not np.linalg.norm(up) > 1e-9:
            raise SceneError(f"{path}: 'up' has no direction; give x, y and z")
        return np.asarray(up / np.linalg.norm(up))
    if otherwise is None and any(stop.target is not None for stop in stops):
        raise SceneError(f"{path}: says no 'up', and the model holds no training cameras to tell it; add 'up'")
    return np.array([0.0, 0.0, 1.0]) if otherwise is None else otherwise


def _focal_of(fields: Fields, height: int, where: str) -> float | None:
    """Pixels; None where nothing is said."""
    if "fov" not in fields:
        return None
    fov = _between(fields, "fov", where, 0.0, NARROWEST, WIDEST)
    return height / 2 / math.tan(math.radians(fov) / 2)


def _side(document: Fields, name: str, path: Path, like: Camera | None) -> int:
    if name not in document:
        if like is None:
            raise SceneError(f"{path}: says no {name!r}, and the model holds no training cameras; add it, in pixels")
        return like.width if name == "width" else like.height
    side = finite(document[name], f"{path}: {name!r}")
    if not (1 <= side <= MAX_IMAGE_SIDE and side == int(side)):
        raise SceneError(f"{path}: {name!r} is {side:g}; give 1 to {MAX_IMAGE_SIDE} pixels")
    return int(side)


def _between(fields: Fields, name: str, where: str, otherwise: float, low: float, high: float) -> float:
    """What the file says, which is refused beyond these, or ``otherwise``, whatever that is."""
    if name not in fields:
        return otherwise
    value = finite(fields[name], f"{where}: {name!r}")
    if not (low < value <= high or value == low > 0):
        raise SceneError(f"{where}: {name!r} is {value:g}; give above {low:g}, up to {high:g}")
    return value
