"""Where the camera goes for pictures of a trained model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np

from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from ringlight.errors import ModelFileError, RecipeError, SceneError
from ringlight.files.camera_paths import interpolated
from ringlight.files.key_frame_flight import flown, frame_times
from ringlight.files.key_frames import read_key_frames
from ringlight.files.nerfstudio_path import NerfstudioPath
from ringlight.files.orbit import Orbit, OrbitWish, orbit_of, showing_whole, up_of
from ringlight.measure.picture_names import picture_name
from ringlight.runs.opened import Opened

FEWEST_DIGITS = 4
"""Of numbered frames, so that films of different length sort alike."""

UNMASKED = "photograph"
"""Background of scenes whose photographs have no masks."""

SOLID = 0.2
"""Opacity of a Gaussian that shows something of its own, relative to the largest: a model that was hardly trained has
faint ones alone."""

FITTED_FRAMES = 24
"""Of an orbit, in which its subject must not be cut."""

MOST_PIXELS = 64_000_000
"""8K is half of this; more would not fit the memory of the machines this runs on."""


@dataclass(frozen=True)
class Film:
    """Cameras in the order in which they are shown, and the file names of their pictures."""

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]

    def thinned(self, frames: int) -> "Film":
        """At most this many of the frames, spread evenly."""
        last = len(self.cameras) - 1
        chosen = np.linspace(0, last, min(frames, last + 1)).round().astype(int).tolist()
        return Film(tuple(self.cameras[i] for i in chosen), tuple(self.names[i] for i in chosen))

    def zoomed(self, factor: float) -> "Film":
        """Focal lengths ``factor`` times as long: below 1 shows more of what is around, above 1 less."""
        cameras = (replace(c, focal=(c.focal[0] * factor, c.focal[1] * factor)) for c in self.cameras)
        return replace(self, cameras=tuple(cameras))

    def resized(self, width: int | None, scale: float | None) -> "Film":
        """All pictures ``width`` pixels wide, or ``scale`` times as large; their shape stays.

        Raises RecipeError for both at once, or a size that no picture can have.
        """
        if width is not None and scale is not None:
            raise RecipeError("--width and --scale both say how large; give one of them")
        cameras = tuple(_resized(camera, width / camera.width if width else scale or 1.0) for camera in self.cameras)
        return replace(self, cameras=cameras)


def film_of_views(scene: Scene) -> Film:
    """The test views. Raises SceneError where the scene has none."""
    if not scene.test:
        raise SceneError(f"{scene.source}: has no test views; give --path orbit, train or interpolated")
    return Film(tuple(view.camera for view in scene.test), _file_names([view.name for view in scene.test]))


def film_from_training(opened: Opened, path: str, frames: int) -> Film:
    """All training cameras that the model file holds ("train"), or a flight through them ("interpolated").

    Raises ModelFileError if it holds none.
    """
    cameras = _training_cameras(opened)
    return _numbered(interpolated(cameras, frames) if path == "interpolated" else cameras)


def film_of_orbit(opened: Opened, wish: OrbitWish, frames: int, zoom: float | None) -> tuple[Film, str]:
    """An orbit round what the training cameras show, and what it took, by the flags that change it.

    Without a ``zoom`` it shows whole what masks cut out of the photographs. Raises ModelFileError for a model file
    without training cameras, RecipeError for a wish that cannot be drawn.
    """
    orbit = orbit_of(_training_cameras(opened), wish)
    film = _numbered(orbit.cameras(frames))
    if zoom is None:
        zoom = _fitting(opened, orbit)
    return film.zoomed(zoom), f"{orbit.words()} --zoom {zoom:.3g}"


def film_of_file(path: NerfstudioPath) -> Film:
    """The cameras of nerfstudio's file."""
    return _numbered(path.cameras)


def film_of_key_frames(
    opened: Opened, path: Path, frames: int | None, fps: float | None, most: int
) -> tuple[Film, float]:
    """The flight through the key frames in a file, and its frames a second. Raises SceneError for a file that is
    damaged, or flights of more than ``most`` frames."""
    cameras = opened.stored.cameras
    like, up = (cameras[0], up_of(cameras)) if cameras else (None, None)
    flight = read_key_frames(path, like, up)
    rate = fps or flight.fps
    times = frame_times(flight, frames, rate, most)
    return _numbered(flown(flight, times)), rate


def _training_cameras(opened: Opened) -> Sequence[Camera]:
    cameras = opened.stored.cameras
    if not cameras:
        raise ModelFileError(
            f"{opened.file}: holds no training cameras; name the folder of photographs by --scene, or give a "
            "camera_path.json by --path"
        )
    return cameras


def _numbered(cameras: Sequence[Camera]) -> Film:
    digits = max(len(str(len(cameras) - 1)), FEWEST_DIGITS)
    return Film(tuple(cameras), tuple(f"{index:0{digits}d}.png" for index in range(len(cameras))))


def _fitting(opened: Opened, orbit: Orbit) -> float:
    """The zoom that cuts nothing of a subject that masks cut out; 1 where the photographs show more than a subject."""
    splats = opened.stored.model.splats()
    if splats is None or opened.stored.header.scene.background == UNMASKED:
        return 1.0
    opacities = splats.gaussians.opacities.detach()
    solid = opacities > SOLID * opacities.max() if len(opacities) else opacities > 0
    return showing_whole(orbit.cameras(FITTED_FRAMES), splats.gaussians.means.detach()[solid].cpu())


def _file_names(views: Sequence[str]) -> tuple[str, ...]:
    """Short names where they stay apart: "test/r_0.png" becomes "r_0.png"."""
    short = tuple(f"{PurePath(view).stem}.png" for view in views)
    return short if len(set(short)) == len(short) else tuple(picture_name(view) for view in views)


def _resized(camera: Camera, factor: float) -> Camera:
    width, height = round(camera.width * factor), round(camera.height * factor)
    if width < 1 or height < 1 or width * height > MOST_PIXELS:
        raise RecipeError(f"pictures of {width}x{height} pixels cannot be made; give another --width or --scale")
    return camera if factor == 1 else camera.resized(width, height)
