"""Where somebody stands: a browser's camera, and how it gets to where a photograph was taken."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import Array, position_of, rotation_of

NARROWEST, WIDEST = 0.02, 3.0
"""Radians of a browser's view, from bottom to top."""

FARTHEST = 1e30
"""World units from the origin; beyond it squares overflow in float32 long since."""

SHORTEST_TURN = 1e-6
"""Length of a quaternion below which it says nothing."""

SAME_PLACE = 2e-3
"""Share of the scene's extent within which a camera stands where a photograph was taken."""

SAME_ANGLE = math.radians(0.2)
"""By which it may be turned: a pixel of a picture of 400."""


@dataclass(frozen=True)
class Standpoint:
    """A browser's camera: ``position`` in world units, ``wxyz`` the rotation from camera to world (OpenCV axes),
    ``fov`` in radians from bottom to top, and the window's size in pixels."""

    position: tuple[float, float, float]
    wxyz: tuple[float, float, float, float]
    fov: float
    width: int
    height: int

    @property
    def is_usable(self) -> bool:
        """Whether a picture can be made: a window may have no size yet, and what comes from a browser is anything."""
        numbers = (*self.position, *self.wxyz, self.fov)
        finite = all(math.isfinite(number) for number in numbers) and max(map(abs, self.position)) < FARTHEST
        sized = self.width > 0 and self.height > 0
        return finite and sized and NARROWEST <= self.fov <= WIDEST and math.hypot(*self.wxyz) > SHORTEST_TURN

    def camera(self, scale: float = 1.0) -> Camera:
        """The pinhole, with sides ``scale`` times the window's."""
        width, height = max(round(self.width * scale), 1), max(round(self.height * scale), 1)
        rotation = Rotation.from_quat(self.wxyz, scalar_first=True).as_matrix().T
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ np.array(self.position)
        focal = height / 2 / math.tan(self.fov / 2)
        pose = torch.from_numpy(matrix.astype(np.float32))
        return Camera(pose, (focal, focal), (width / 2, height / 2), width, height)


def standpoint_at(camera: Camera, width: int, height: int, strips: int = 1) -> Standpoint:
    """Where ``camera`` stands, with a window of this size of which each of so many ``strips`` shows all of its picture,
    which may be of another shape."""
    focal = min(camera.focal[1] * height / camera.height, camera.focal[0] * width / strips / camera.width)
    x, y, z, w = Rotation.from_matrix(rotation_of(camera).T).as_quat().tolist()
    place = tuple(position_of(camera).tolist())
    return Standpoint(place, (w, x, y, z), min(2 * math.atan(height / 2 / focal), WIDEST), width, height)


def is_same_pose(one: Camera, other: Camera, extent: float) -> bool:
    """Whether the two stand in one place and look one way; ``extent`` of the scene, world units."""
    if float(np.linalg.norm(position_of(one) - position_of(other))) > SAME_PLACE * extent:
        return False
    # The sine of half the angle: the cosine says nothing of small ones in float32.
    chord = float(np.linalg.norm(rotation_of(one) - rotation_of(other))) / (2 * math.sqrt(2))
    return 2 * math.asin(min(chord, 1.0)) <= SAME_ANGLE


def looked_at(camera: Camera, center: Array) -> Array:
    """The point on the optical axis that is nearest to ``center``, in front of the camera: a drag turns round it."""
    position, forward = position_of(camera), rotation_of(camera)[2]
    offset = center - position
    depth = float(offset @ forward)
    return position + max(depth, 0.1 * float(np.linalg.norm(offset)), 1e-6) * forward
