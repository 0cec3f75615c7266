"""A scene: posed photographs, split into training and test views, and the points to start from."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.computed_once import computed_once
from ringlight.core.origin import Origin


@dataclass(frozen=True)
class View:
    """One photograph. ``load`` decodes it: uint8 [H W 3] or, with an alpha mask, [H W 4]; called lazily, and may keep
    what it decoded. ``check``, where there is one, raises what decoding would, keeps nothing, and takes less time;
    ``mark`` tells the files' content from another."""

    name: str
    camera: Camera
    load: Callable[[], UInt8[np.ndarray, "H W C"]]
    has_alpha: bool = False
    check: Callable[[], object] | None = None
    mark: Callable[[], str] | None = None

    def refuse_damaged(self) -> None:
        """Decode the photograph to see that it can be. Raises SceneError."""
        (self.check or self.load)()

    def image(self, background: Float[Tensor, "3"]) -> Float[Tensor, "3 H W"]:
        """The photograph in [0, 1], planar, composited over ``background`` in float where it has an alpha mask."""
        pixels = torch.from_numpy(self.load()).permute(2, 0, 1).float().div_(255)
        if pixels.shape[0] == 3:
            return pixels.contiguous()
        color, alpha = pixels[:3], pixels[3:]
        return torch.lerp(background[:, None, None], color, alpha)


DARKEST = 0.25 / 255
"""How far from black, and from white, a colour model starts a point's colour at least: there a logit would be infinite,
and a colour that is clamped at black has no gradient. A quarter of an 8-bit step still rounds to black."""


@dataclass(frozen=True)
class PointCloud:
    """Points to start from, world units; ``colors`` are display-referred sRGB in [0, 1].

    ``normals``, where known, are unit and point out of the surface.
    """

    positions: Float[Tensor, "P 3"]
    colors: Float[Tensor, "P 3"]
    normals: Float[Tensor, "P 3"] | None = None
    origin: Origin = "scene"

    @property
    def measured(self) -> bool:
        """Whether they lie on what was photographed, as random ones do not."""
        return self.origin != "random"


WARNING = "warning: "
"""How notes begin that must not be missed: commands that are told to be quiet say them too."""


@dataclass(frozen=True)
class Scene:
    """What every loader returns.

    ``extent`` is 1.1 times the largest distance of a training camera from their mean (3DGS's spatial unit), or half the
    box where all stand in one place; ``box`` the axis-aligned box [low, high] that holds the subject; ``background``
    the name in force ("white", "black", "random", or "photograph" where images have no alpha); ``source`` the folder's
    full path; ``notes`` what the loader decided and a reader should know (filter, downscale, sub-model, ...), also
    ``warnings``, which nobody must miss.
    """

    name: str
    train: tuple[View, ...]
    test: tuple[View, ...]
    points: PointCloud
    extent: float
    box: Float[Tensor, "2 3"]
    background: str
    format: str
    source: str
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of the notes those that must not be missed; they begin with :data:`WARNING`, which is left out here."""
        return tuple(note.removeprefix(WARNING) for note in self.notes if note.startswith(WARNING))

    @computed_once
    def background_color(self) -> Float[Tensor, "3"]:
        """What test images are composited over: white unless black was asked for."""
        return torch.zeros(3) if self.background == "black" else torch.ones(3)

    @property
    def pixels(self) -> int:
        """Pixels of the largest training photograph."""
        return max(view.camera.width * view.camera.height for view in self.train)


SMALLEST_EXTENT = 1e-3
"""World units; cameras closer together than this stand in one place."""


def camera_extent(cameras: list[Camera]) -> float:
    """1.1 times the largest distance of a camera from the mean position (3DGS's unit), at least SMALLEST_EXTENT."""
    positions = torch.stack([camera.position for camera in cameras])
    radius = (positions - positions.mean(0)).norm(dim=1).max().item()
    return max(1.1 * radius, SMALLEST_EXTENT)
