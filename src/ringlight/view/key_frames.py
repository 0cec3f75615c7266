"""Key frames, the flight through them, and its file."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import position_of, rotation_of
from ringlight.files.key_frame_flight import flown, frame_times
from ringlight.files.key_frames import KeyFrames, Stop, write_key_frames
from ringlight.files.nerfstudio_path import write_nerfstudio_path

FPS = 30.0
"""Frames a second of paths that are written."""

SHOWN = 100
"""Points of the line that is shown of a way."""

LONGEST = 300.0
"""Seconds: cameras of a longer film take a while to make, in which a training would wait."""

SHORTEST = 1.0

STOPS, FRAMES = "key frames", "all frames, as nerfstudio"
FILES = (STOPS, FRAMES)
"""What a written file holds; of either `ringlight render` makes the film that was previewed."""


class Keys:
    """Cameras that a film passes in this order, evenly spaced in time; all have the first one's picture size."""

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

    def flight(self, seconds: float) -> KeyFrames:
        """Through them, of which there is at least one."""
        first, seconds = self.cameras[0], min(max(seconds, SHORTEST), LONGEST)
        times = np.linspace(0.0, seconds, len(self.cameras)).tolist()
        stops = tuple(
            Stop(position_of(camera), rotation_of(camera), None, camera.focal[1], time)
            for camera, time in zip(self.cameras, times, strict=True)
        )
        # Every stop has its rotation, so that nothing goes by the up axis.
        return KeyFrames(stops, seconds, False, np.array([0.0, 0.0, 1.0]), first.width, first.height, FPS)

    def film(self, seconds: float) -> list[Camera]:
        """The cameras of a film of so many seconds, at FPS; one with a single key frame, none without."""
        if not self.cameras:
            return []
        flight = self.flight(seconds)
        return flown(flight, frame_times(flight, None, FPS, round(LONGEST * FPS) + 1))

    def way(self) -> Float[np.ndarray, "F 3"]:
        """Where the camera goes, world units; empty with fewer than two key frames."""
        if len(self.cameras) < 2:
            return np.zeros((0, 3))
        flight = self.flight(SHORTEST)
        return np.stack([position_of(camera) for camera in flown(flight, np.linspace(0.0, flight.seconds, SHOWN))])

    def write(self, folder: Path, seconds: float, holds: str = STOPS) -> Path:
        """The film as a new file in ``folder`` that ``holds`` one of FILES. Raises OutputError."""
        number = 1
        while (path := folder / f"path-{number}.json").exists():
            number += 1
        if holds == FRAMES:
            write_nerfstudio_path(path, self.film(seconds), FPS)
        else:
            write_key_frames(path, self.flight(seconds))
        return path
