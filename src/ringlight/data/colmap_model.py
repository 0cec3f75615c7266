"""COLMAP's records: cameras, registered images, and what its camera models mean."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.scene import PointCloud
from ringlight.core.words import counted
from ringlight.data.folder import shown
from ringlight.data.intrinsics import MAX_PIXELS, Intrinsics, checked_intrinsics, checked_lens
from ringlight.data.poses import MAX_COORDINATE
from ringlight.errors import SceneError


@dataclass(frozen=True)
class CameraModel:
    """One of COLMAP's camera models: its name, how many parameters it has, and how many of them are focal lengths.

    Parameters are stored as focal lengths, centre x, centre y, distortion. ``coefficients`` are OpenCV's names of the
    last; None where the model has others, which are not supported unless they are zero. A model ``by_angle`` (fisheye)
    is no pinhole even then.
    """

    name: str
    parameters: int
    focals: int
    coefficients: str | None
    by_angle: bool = False


CAMERA_MODELS = dict(
    enumerate(
        [
            CameraModel("SIMPLE_PINHOLE", 3, 1, ""),
            CameraModel("PINHOLE", 4, 2, ""),
            CameraModel("SIMPLE_RADIAL", 4, 1, "k1"),
            CameraModel("RADIAL", 5, 1, "k1 k2"),
            CameraModel("OPENCV", 8, 2, "k1 k2 p1 p2"),
            CameraModel("OPENCV_FISHEYE", 8, 2, "k1 k2 k3 k4", True),
            CameraModel("FULL_OPENCV", 12, 2, "k1 k2 p1 p2 k3 k4 k5 k6"),
            CameraModel("FOV", 5, 2, None),
            CameraModel("SIMPLE_RADIAL_FISHEYE", 4, 1, "k1", True),
            CameraModel("RADIAL_FISHEYE", 5, 1, "k1 k2", True),
            CameraModel("THIN_PRISM_FISHEYE", 12, 2, None, True),
            CameraModel("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, None, True),
            CameraModel("SIMPLE_DIVISION", 4, 1, None),
            CameraModel("DIVISION", 5, 2, None),
            CameraModel("SIMPLE_FISHEYE", 3, 1, "", True),
            CameraModel("FISHEYE", 4, 2, "", True),
        ]
    )
)
"""By the number that cameras.bin uses (https://colmap.github.io/cameras.html)."""

MODELS_BY_NAME = {model.name: model for model in CAMERA_MODELS.values()}
"""By the name that cameras.txt uses."""


@dataclass(frozen=True)
class ColmapCamera:
    """A lens: model name, size in pixels, parameters in COLMAP's order."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """A registered image; the pose takes world points to the camera, quaternion wxyz."""

    name: str
    camera_id: int
    quaternion: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]


def intrinsics_of(camera: ColmapCamera, where: str, remedy: str) -> Intrinsics:
    """The camera without a pose; COLMAP's pixel centres lie at .5, as ours do.

    Raises:
        SceneError: a model that is not supported, unusable numbers.
    """
    model = MODELS_BY_NAME.get(camera.model)
    if model is None:
        raise SceneError(f"{where} has the camera model {shown(camera.model)}, which is not known; {remedy}")
    if len(camera.parameters) != model.parameters:
        counts = f"{counted(len(camera.parameters), 'parameter')} where {model.name} has {model.parameters}"
        raise SceneError(f"{where} has {counts}; copy the model again")
    focal, center = camera.parameters[: model.focals], camera.parameters[model.focals : model.focals + 2]
    distortion = camera.parameters[model.focals + 2 :]
    if model.coefficients is None and (model.by_angle or any(distortion)):
        raise SceneError(f"{where} has the camera model {model.name!r}, which cannot be undistorted here; {remedy}")
    named = dict(zip((model.coefficients or "").split(), distortion, strict=False))
    lens = checked_lens(model.name, model.by_angle, named, where)
    size = (_pixels(camera.width), _pixels(camera.height))
    return checked_intrinsics((focal[0], focal[-1]), (center[0], center[1]), size, where, lens)


def _pixels(side: int) -> float:
    """Infinite beyond what is believed: text may hold more digits than a float."""
    return float(side) if abs(side) <= MAX_PIXELS else math.inf if side > 0 else -math.inf


def cloud_of(rows: Float[np.ndarray, "P 6"]) -> PointCloud:
    """A point cloud of rows x y z, red green blue in 0..255; rows with numbers beyond belief are left out."""
    usable = rows[(np.abs(rows) <= MAX_COORDINATE).all(1)]  # which no NaN is
    positions, colors = usable[:, :3].astype(np.float32), usable[:, 3:].astype(np.float32)
    return PointCloud(torch.from_numpy(positions), torch.from_numpy(colors / 255).clamp(0, 1))
