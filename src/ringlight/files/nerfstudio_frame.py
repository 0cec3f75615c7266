"""nerfstudio's ``dataparser_transforms.json``: how it moved a scene before it trained.

It turns, centres and scales what a scene's file says: x in nerfstudio = ``scale`` * ``transform`` x. ``transform``
[3 4] begins at the world before the scene's own ``applied_transform``, ``scale`` before its ``applied_scale``; a scene
read from ``transforms.json`` lies behind these. nerfstudio's viewer writes camera paths in the world in which it
trained.
Source: docs.nerf.studio, "Data conventions".
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ringlight.data.json_fields import finite, matrix_of, read_object
from ringlight.errors import SceneError

FRAME_NAME = "dataparser_transforms.json"

REMEDY = "copy it again from nerfstudio's output, or take it away if the cameras are in the scene's world"


@dataclass(frozen=True)
class Moved:
    """x moved = ``scale`` * ``transform`` x."""

    transform: Float[np.ndarray, "4 4"]
    scale: float

    def undone(self, pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The camera-to-world pose, whose place was scaled and whose axes were not, as it was before."""
        placed = pose.copy()
        placed[:3, 3] /= self.scale
        return np.linalg.inv(self.transform) @ placed

    def after(self, first: "Moved") -> "Moved":
        """What is left of it where ``first`` has been done."""
        return Moved(self.transform @ np.linalg.inv(first.transform), self.scale / first.scale)


UNMOVED = Moved(np.eye(4), 1.0)


def frame_beside(path: Path) -> Moved | None:
    """How nerfstudio moved the scene of the camera path in ``path``, by the file beside it; None without one.

    Raises SceneError for one that is damaged.
    """
    file = path.with_name(FRAME_NAME)
    return moved_by(file, "transform", "scale") if file.is_file() else None


def moved_by(file: Path, transform: str, scale: str) -> Moved:
    """What the fields of a JSON file say; one that is absent moves nothing. Raises SceneError for damage."""
    fields = read_object(file)
    matrix = matrix_of(fields, transform, str(file), REMEDY) if transform in fields else np.eye(4)
    factor = finite(fields.get(scale, 1.0), f"{file}: {scale!r}")
    with np.errstate(all="ignore"):
        volume = abs(np.linalg.det(matrix))
    if not (factor > 0 and 0 < volume < np.inf):
        raise SceneError(f"{file}: {transform!r} and {scale!r} cannot be undone; {REMEDY}")
    return Moved(matrix, factor)
