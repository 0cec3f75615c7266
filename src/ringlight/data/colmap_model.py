"""COLMAP's records: cameras, registered images, and which of its camera models are a pinhole."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.scene import PointCloud
from ringlight.data.folder import shown
from ringlight.data.intrinsics import Intrinsics, checked_intrinsics
from ringlight.data.poses import MAX_COORDINATE
from ringlight.errors import SceneError


@dataclass(frozen=True)
class CameraModel:
    """One of COLMAP's camera models: its name, how many parameters it has, and how many of them are focal lengths.

    Parameters are stored as focal lengths, centre x, centre y, distortion. ``is_perspective`` says that the model is
    a pinhole when its distortion is zero; a fisheye model projects by angle even then.
    """

    name: str
    parameters: int
    focals: int
    is_perspective: bool


CAMERA_MODELS: dict[int, CameraModel] = {
    number: CameraModel(*model)
    for number, model in enumerate(
        [
            ("SIMPLE_PINHOLE", 3, 1, True),
            ("PINHOLE", 4, 2, True),
            ("SIMPLE_RADIAL", 4, 1, True),
            ("RADIAL", 5, 1, True),
            ("OPENCV", 8, 2, True),
            ("OPENCV_FISHEYE", 8, 2, False),
            ("FULL_OPENCV", 12, 2, True),
            ("FOV", 5, 2, True),
            ("SIMPLE_RADIAL_FISHEYE", 4, 1, False),
            ("RADIAL_FISHEYE", 5, 1, False),
            ("THIN_PRISM_FISHEYE", 12, 2, False),
            ("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, False),
            ("SIMPLE_DIVISION", 4, 1, True),
            ("DIVISION", 5, 2, True),
            ("SIMPLE_FISHEYE", 3, 1, False),
            ("FISHEYE", 4, 2, False),
        ]
    )
}
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


def pinhole(camera: ColmapCamera, where: str, remedy: str) -> Intrinsics:
    """The camera as a pinhole; COLMAP's pixel centres lie at .5, as ours do.

    Raises:
        SceneError: a lens with distortion, a model that is none of a perspective lens, unusable numbers.
    """
    model = MODELS_BY_NAME.get(camera.model)
    if model is None or not model.is_perspective:
        raise SceneError(f"{where} has the camera model {shown(camera.model)}, which is not a pinhole; {remedy}")
    if len(camera.parameters) != model.parameters:
        counts = f"{len(camera.parameters)} parameters where {model.name} has {model.parameters}"
        raise SceneError(f"{where} has {counts}; copy the model again")
    focal, center = camera.parameters[: model.focals], camera.parameters[model.focals : model.focals + 2]
    if any(camera.parameters[model.focals + 2 :]):
        raise SceneError(
            f"{where} has the camera model {shown(camera.model)} with distortion that is not zero; {remedy}"
        )
    size = (float(camera.width), float(camera.height))
    return checked_intrinsics((focal[0], focal[-1]), (center[0], center[1]), size, where)


def cloud_of(rows: Float[np.ndarray, "P 6"]) -> PointCloud:
    """A point cloud of rows x y z, red green blue in 0..255; rows with numbers beyond belief are left out."""
    usable = rows[(np.abs(rows) <= MAX_COORDINATE).all(1)]  # which no NaN is
    positions, colors = usable[:, :3].astype(np.float32), usable[:, 3:].astype(np.float32)
    return PointCloud(torch.from_numpy(positions), torch.from_numpy(colors / 255).clamp(0, 1))
