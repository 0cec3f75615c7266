"""Camera poses as files give them, checked and brought to the one convention of :mod:`ringlight.core.camera`."""

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.camera import Camera
from ringlight.data.intrinsics import Intrinsics
from ringlight.errors import SceneError

MAX_COORDINATE = 1e9
"""Largest coordinate believed of a camera or point, scene units: squares and their sums stay far inside float32."""

RIGID_TOLERANCE = 1e-2
"""Largest departure of a squared singular value from 1: rounding to three digits passes, a shear or a wrong row does
not."""

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Camera axes right, up, backward (Blender, nerfstudio) to right, down, forward."""


def world_to_camera_from_opengl(camera_to_world: Float[np.ndarray, "4 4"], where: str) -> Float[np.ndarray, "4 4"]:
    """The OpenCV world-to-camera matrix of an OpenGL camera-to-world matrix.

    A uniform scale in the matrix is dropped (a pinhole has no size), rounding is removed by taking the nearest
    rotation; ``where`` names file and frame.

    Raises:
        SceneError: non-finite, sheared, mirrored, or with a last row other than 0 0 0 1.
    """
    remedy = "export the cameras again, or remove the frame"
    if not np.isfinite(camera_to_world).all() or np.abs(camera_to_world[:3, 3]).max() > MAX_COORDINATE:
        raise SceneError(f"{where} has a pose that is not finite, or farther than {MAX_COORDINATE:g} away; {remedy}")
    if np.abs(camera_to_world[3] - [0, 0, 0, 1]).max() > RIGID_TOLERANCE:
        raise SceneError(f"{where} has a pose whose last row is not 0 0 0 1; {remedy}")
    rotation = nearest_rotation(camera_to_world[:3, :3])
    if rotation is None:
        raise SceneError(f"{where} has a pose that shears, flattens or mirrors space; {remedy}")
    to_camera = (rotation @ OPENGL_TO_OPENCV).T
    return rigid_matrix(to_camera, -to_camera @ camera_to_world[:3, 3])


def world_to_camera_from_quaternion(
    quaternion: Float[np.ndarray, "4"], translation: Float[np.ndarray, "3"], where: str
) -> Float[np.ndarray, "4 4"]:
    """The world-to-camera matrix of COLMAP's quaternion (wxyz, any length but zero) and translation.

    Raises:
        SceneError: non-finite, a zero quaternion, or a camera farther than :data:`MAX_COORDINATE` away.
    """
    numbers = np.concatenate([quaternion, translation])
    largest = np.abs(quaternion).max()
    if not np.isfinite(numbers).all() or np.abs(translation).max() > MAX_COORDINATE or largest < 1e-6:
        raise SceneError(f"{where} has a pose that is not finite or has no direction; run the mapper again")
    from scipy.spatial.transform import Rotation  # 25 MB that no other reader wants

    # Divided first: squares of damaged numbers near 1e300 would leave the range of float64.
    w, x, y, z = quaternion / largest
    return rigid_matrix(Rotation.from_quat([x, y, z, w]).as_matrix(), translation)


def nearest_rotation(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"] | None:
    """The rotation nearest to a finite matrix, up to a positive factor; None where the matrix is far from one."""
    largest = np.abs(matrix).max()
    if largest == 0:
        return None
    # Divided first: the determinant of entries near 1e±200 would leave the range of float64.
    left, stretches, right = np.linalg.svd(matrix / largest)
    scale = stretches.mean()
    if np.linalg.det(left @ right) < 0 or np.abs((stretches / scale) ** 2 - 1).max() > RIGID_TOLERANCE:
        return None
    return left @ right


def rigid_matrix(rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Rotation and translation as one homogeneous matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def camera_of(world_to_camera: Float[np.ndarray, "4 4"], intrinsics: Intrinsics) -> Camera:
    """The camera in float32, with the pixel grid of ``intrinsics``."""
    matrix = torch.from_numpy(world_to_camera.astype(np.float32))
    return Camera(matrix, intrinsics.focal, intrinsics.center, intrinsics.width, intrinsics.height)
