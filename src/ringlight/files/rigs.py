"""What stands at a camera's place: one eye, two side by side, or one that sees all round. Each asks for pinhole views
and makes one picture of what they show."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels

Look = Callable[[Camera], Channels]
"""What a model shows to a pinhole camera: layers [H W c] by name."""

COMFORT = 30.0
"""Distance of the nearest surface over the baseline: the rule of stereo photographers, "one in thirty"."""


@runtime_checkable
class Rig(Protocol):
    """One of this file's."""

    @property
    def name(self) -> str:
        """What it is called in records."""
        ...

    def see(self, look: Look, camera: Camera) -> Channels:
        """The layers that it shows at ``camera``, [h w c], h and w as of :meth:`size`."""
        ...

    def size(self, camera: Camera) -> tuple[int, int]:
        """Width and height of its pictures, pixels."""
        ...


@dataclass(frozen=True)
class Pinhole:
    """The camera itself."""

    name: ClassVar[str] = "pinhole"

    def see(self, look: Look, camera: Camera) -> Channels:
        return look(camera)

    def size(self, camera: Camera) -> tuple[int, int]:
        return camera.width, camera.height


@dataclass(frozen=True)
class Stereo:
    """Two eyes ``baseline`` world units apart, about the camera's place: the left one's picture, right of it the right
    one's. Their axes are parallel, so a point at depth z lies focal · baseline / z pixels farther left in the right
    picture."""

    baseline: float
    name: ClassVar[str] = "stereo"

    def eyes(self, camera: Camera) -> tuple[Camera, Camera]:
        """Left and right."""
        return _moved_right(camera, -self.baseline / 2), _moved_right(camera, self.baseline / 2)

    def see(self, look: Look, camera: Camera) -> Channels:
        left, right = (look(eye) for eye in self.eyes(camera))
        return {name: torch.cat([left[name], right[name]], 1) for name in left}

    def size(self, camera: Camera) -> tuple[int, int]:
        return 2 * camera.width, camera.height


def comfortable_baseline(near: float) -> float:
    """World units between the eyes where the nearest surface is ``near`` away."""
    return near / COMFORT


def _moved_right(camera: Camera, distance: float) -> Camera:
    matrix = camera.world_to_camera.clone()
    matrix[0, 3] -= distance
    return replace(camera, world_to_camera=matrix)


FACES = torch.tensor(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],  # ahead
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],  # right
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],  # behind
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],  # left
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],  # above
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],  # below
    ],
    dtype=torch.float32,
)
"""Right, down and forward of the six cameras, in the frame of the one at whose place they stand."""

BORDER = 2
"""Pixels round a face's 90 degrees, so that a pixel at its edge has neighbours on all sides."""

BAND_PIXELS = 1 << 19
"""Of a panorama that are worked on at once: what is kept of each on the way takes some hundred bytes."""

NEAREST_ONLY = ("depth", "normal")
"""Layers whose values must not be mixed across an edge: no surface lies between two surfaces."""


@dataclass(frozen=True)
class Panorama:
    """All directions, equirectangular: ``width`` x ``width`` / 2 pixels. The middle is what the camera looks at, a
    quarter of the width is 90 degrees to the right, the upper edge is the camera's up.

    Made of six square views, each drawn and shaded for its own rays, and resampled. "depth" is the distance from the
    optical centre, along the ray.
    """

    width: int
    name: ClassVar[str] = "panorama"

    def size(self, camera: Camera) -> tuple[int, int]:
        return self.width, self.width // 2

    def see(self, look: Look, camera: Camera) -> Channels:
        face_of = torch.empty(self.width // 2, self.width, dtype=torch.uint8)
        # By bands: what is worked out for a pixel on the way takes ten times the room of the picture.
        for rows in bands(*face_of.shape):
            face_of[rows] = (self.directions(rows) @ FACES[:, 2].T).argmax(-1)
        whole: Channels = {}
        for index, face in enumerate(self.faces(camera)):
            shown = {name: values.cpu() for name, values in _with_distances(look(face), face).items()}
            for name, values in shown.items():
                whole.setdefault(name, torch.zeros(*face_of.shape, values.shape[-1]))
            for rows in bands(*face_of.shape):
                here = face_of[rows] == index
                if here.any():
                    band = {name: picture[rows] for name, picture in whole.items()}
                    _fill(band, here, self.directions(rows)[here] @ FACES[index].T, face, shown)
        return whole

    def directions(self, rows: slice = slice(None)) -> Float[Tensor, "h W 3"]:
        """Unit directions through the pixels' centres of these rows, in the camera's frame: right, down, forward."""
        height = self.width // 2
        longitude = ((torch.arange(self.width) + 0.5) / self.width - 0.5) * 2 * math.pi
        latitude = ((torch.arange(height) + 0.5) / height - 0.5) * math.pi
        flat, down = latitude.cos()[rows, None], latitude.sin()[rows, None]
        return torch.stack([longitude.sin() * flat, down.expand(-1, self.width), longitude.cos() * flat], -1)

    def faces(self, camera: Camera) -> list[Camera]:
        """Six square cameras at the place of ``camera``, in the order of :data:`FACES`. Along their axes a pixel is as
        large as one of the panorama's horizon, elsewhere it is smaller. Finer faces would show another picture:
        Gaussians are dilated by pixels."""
        inner = max(math.ceil(self.width / math.pi), 1)
        side = inner + 2 * BORDER
        turned = []
        for face in FACES:
            matrix = camera.world_to_camera.clone()
            matrix[:3] = face @ matrix[:3]
            turned.append(Camera(matrix, (inner / 2, inner / 2), (side / 2, side / 2), side, side))
        return turned


def _fill(band: Channels, here: Bool[Tensor, "h W"], rays: Float[Tensor, "n 3"], face: Camera, shown: Channels) -> None:
    """The pixels ``here`` of a band, whose ``rays`` are in the face's frame."""
    x, y, z = rays.unbind(-1)
    places = torch.stack([face.focal[0] * x / z, face.focal[1] * y / z], -1) / (face.width / 2)
    for name, values in shown.items():
        band[name][here] = _sampled(values, places, nearest=name in NEAREST_ONLY)


def bands(height: int, width: int) -> Iterator[slice]:
    """Rows of a picture in bands of at most BAND_PIXELS, or of one row, from the upper edge on."""
    step = max(BAND_PIXELS // width, 1)
    return (slice(first, min(first + step, height)) for first in range(0, height, step))


def _with_distances(shown: Channels, face: Camera) -> Channels:
    """Depth along the ray in place of along the axis: the axis is another one on the next face."""
    if "depth" not in shown:
        return shown
    forward = face.ray_directions() @ face.forward
    return {**shown, "depth": shown["depth"].cpu() / forward[..., None]}


def _sampled(values: Float[Tensor, "S S c"], places: Float[Tensor, "n 2"], nearest: bool) -> Float[Tensor, "n c"]:
    """At places in [-1, 1], from edge to edge of the outer pixels."""
    mode = "nearest" if nearest else "bilinear"
    picture = values.permute(2, 0, 1)[None]
    found = torch.nn.functional.grid_sample(picture, places[None, None], mode, "border", align_corners=False)
    return found[0, :, 0].T
