"""Key frames, and the film between them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import flight, position_of
from ringlight.files.nerfstudio_path import write_nerfstudio_path

FPS = 30.0
"""Frames a second of paths that are written."""

SHOWN = 100
"""Points of the line that is shown of a way."""

LONGEST = 300.0
"""Seconds: cameras of a longer film take a while to make, in which a training would wait."""

SHORTEST = 1.0


class KeyFrames:
    """Cameras that a film passes in this order; all have the first one's picture size."""

    def __init__(self) -> None:
        self.cameras: list[Camera] = []

    def add(self, camera: Camera) -> None:
        """Behind the last."""
        first = self.cameras[0] if self.cameras else camera
        # The height stays the field of view: windows of another shape see more or less at their sides.
        focal = camera.focal[1] * first.height / camera.height
        lens = ((focal, focal), (first.width / 2, first.height / 2), first.width, first.height)
        self.cameras.append(Camera(camera.world_to_camera, *lens))

    def drop(self) -> None:
        """The last."""
        del self.cameras[-1:]

    def film(self, seconds: float) -> list[Camera]:
        """The cameras of a film of so many seconds, at FPS; empty without key frames."""
        seconds = min(max(seconds, SHORTEST), LONGEST)
        return flight(self.cameras, max(round(seconds * FPS), len(self.cameras))) if self.cameras else []

    def way(self) -> Float[np.ndarray, "F 3"]:
        """Where the camera goes, world units; empty with fewer than two key frames."""
        if len(self.cameras) < 2:
            return np.zeros((0, 3))
        return np.stack([position_of(camera) for camera in flight(self.cameras, max(SHOWN, len(self.cameras)))])

    def write(self, folder: Path, seconds: float) -> Path:
        """The film as a new file in ``folder``. Raises OutputError."""
        number = 1
        while (path := folder / f"path-{number}.json").exists():
            number += 1
        write_nerfstudio_path(path, self.film(seconds), FPS)
        return path
