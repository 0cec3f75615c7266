"""nerfstudio's ``camera_path.json``: the cameras of a film, as its viewer, its Blender add-on and ours write them.

``render_width`` and ``render_height`` in pixels; ``camera_path``, a list of cameras with ``camera_to_world`` (16
numbers by rows; axes right, up, backward) and ``fov`` (degrees from the picture's bottom to its top); ``fps`` and
``seconds``. Of ``camera_type`` only "perspective" is a pinhole. nerfstudio ignores ``aspect``, and so do we.
Source: docs.nerf.studio, "Rendering" and "Blender VFX add-on".
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.camera import Camera
from ringlight.core.kernel_limits import MAX_IMAGE_SIDE
from ringlight.data.json_fields import Fields, finite, number, read_object, text
from ringlight.data.poses import world_to_camera_from_opengl
from ringlight.errors import SceneError
from ringlight.files.atomic import write_text
from ringlight.files.frame_rate import FASTEST, SLOWEST
from ringlight.files.nerfstudio_frame import UNMOVED, Moved

NARROWEST, WIDEST = 1e-3, 179.0
"""Degrees of a pinhole's view: beyond these its focal length is no number of pixels."""

FLIPPED = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between OpenCV's axes of a camera and OpenGL's."""


@dataclass(frozen=True)
class NerfstudioPath:
    """Cameras in the file's order, in the scene's world; ``fps`` frames a second, None where it does not say."""

    cameras: tuple[Camera, ...]
    fps: float | None


def read_nerfstudio_path(path: Path, most: int, moved: Moved = UNMOVED) -> NerfstudioPath:
    """The path in a file, of a scene that nerfstudio had ``moved``.

    Raises SceneError for a file that is damaged, of another kind of camera, or of more than ``most`` cameras.
    """
    if not path.is_file():
        raise SceneError(f"{path}: there is no such file; give key frames, or a camera_path.json of nerfstudio")
    document = read_object(path)
    frames = document.get("camera_path")
    if not isinstance(frames, list) or not frames:
        raise SceneError(f"{path}: holds no 'camera_path' with cameras; export the path from nerfstudio's viewer again")
    if len(frames) > most:
        raise SceneError(f"{path}: has {len(frames)} cameras; give at most {most}, an hour of film, and join several")
    kind = text(document, "camera_type", str(path))
    if kind not in (None, "perspective"):
        raise SceneError(f"{path}: its camera_type is {kind[:40]!r}; only 'perspective' can be drawn, export it so")
    size = _side(document, "render_width", path), _side(document, "render_height", path)
    fps = number(document, "fps", str(path), None)
    if fps is not None and not SLOWEST <= fps <= FASTEST:
        raise SceneError(f"{path}: 'fps' is {fps:g}; give {SLOWEST:g} to {FASTEST:g}")
    cameras = tuple(_camera(frame, size, moved, f"{path}: camera {index}") for index, frame in enumerate(frames))
    return NerfstudioPath(cameras, fps)


def write_nerfstudio_path(path: Path, cameras: Sequence[Camera], fps: float) -> None:
    """The cameras, at least one and all of one picture size, in the scene's world; their lenses' centres are those of
    the pictures. Raises OutputError."""
    first = cameras[0]
    frames = [
        {
            "camera_to_world": (_camera_to_world(camera) @ FLIPPED).flatten().tolist(),
            "fov": math.degrees(2 * math.atan(camera.height / 2 / camera.focal[1])),
            "aspect": camera.width / camera.height,
        }
        for camera in cameras
    ]
    document = {
        "camera_type": "perspective",
        "render_width": first.width,
        "render_height": first.height,
        "fps": fps,
        "seconds": len(cameras) / fps,
        "camera_path": frames,
    }
    write_text(path, json.dumps(document, allow_nan=False) + "\n")


def _camera_to_world(camera: Camera) -> Float[np.ndarray, "4 4"]:
    matrix = np.eye(4)
    rotation = camera.world_to_camera[:3, :3].double().numpy()
    matrix[:3, :3], matrix[:3, 3] = rotation.T, camera.position.double().numpy()
    return matrix


def _side(document: Fields, name: str, path: Path) -> int:
    side = finite(document.get(name), f"{path}: {name!r}")
    if not (1 <= side <= MAX_IMAGE_SIDE and side == int(side)):
        raise SceneError(f"{path}: {name!r} is {side:g}; give 1 to {MAX_IMAGE_SIDE} pixels")
    return int(side)


def _camera(frame: Any, size: tuple[int, int], moved: Moved, where: str) -> Camera:
    if not isinstance(frame, dict):
        raise SceneError(f"{where} is not an object with 'camera_to_world'; export the path again")
    fov = finite(frame.get("fov"), f"{where}: 'fov'")
    if not NARROWEST <= fov <= WIDEST:
        raise SceneError(f"{where}: 'fov' is {fov:g} degrees; give {NARROWEST:g} to {WIDEST:g}")
    numbers = _flat(frame.get("camera_to_world"))
    if len(numbers) != 16:
        raise SceneError(f"{where}: 'camera_to_world' is not 16 numbers; export the path again")
    entries = [finite(value, f"{where}: an entry of 'camera_to_world'") for value in numbers]
    matrix = world_to_camera_from_opengl(moved.undone(np.array(entries).reshape(4, 4)), where)
    width, height = size
    focal = height / 2 / math.tan(math.radians(fov) / 2)
    return Camera(torch.from_numpy(matrix.astype(np.float32)), (focal, focal), (width / 2, height / 2), width, height)


def _flat(matrix: Any) -> Sequence[Any]:
    """Sixteen numbers in a row, or the four rows of four that some writers make of them."""
    if not isinstance(matrix, list):
        return ()
    if len(matrix) == 4 and all(isinstance(row, list) and len(row) == 4 for row in matrix):
        return [value for row in matrix for value in row]
    return matrix
