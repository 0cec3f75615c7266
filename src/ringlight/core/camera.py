"""The pinhole camera. Axes, pixels and depth are defined here and nowhere else.

Conventions: OpenCV axes (x right, y down, z forward); pixel centres at ``.5``; depth is camera ``z``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.computed_once import computed_once
from ringlight.core.kernel_limits import MAX_IMAGE_SIDE
from ringlight.errors import BackendError

if TYPE_CHECKING:
    from ringlight import _kernels


@dataclass(frozen=True)
class Camera:
    """One pinhole view of the world.

    ``focal`` and ``center`` are in pixels (x, y); ``world_to_camera`` is a rigid motion, float32 on the CPU.
    """

    world_to_camera: Float[Tensor, "4 4"]
    focal: tuple[float, float]
    center: tuple[float, float]
    width: int
    height: int

    def __getstate__(self) -> dict[str, object]:
        """For another process: without what was worked out of it."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @computed_once
    def position(self) -> Float[Tensor, "3"]:
        """The optical centre in world units."""
        rotation, translation = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        return (-rotation.T @ translation).contiguous()

    @computed_once
    def pose_numbers(self) -> list[float]:
        """The first three rows of ``world_to_camera``, one after the other."""
        numbers: list[float] = self.world_to_camera[:3].flatten().tolist()
        return numbers

    @computed_once
    def native(self) -> "_kernels.Camera":
        """The same for the compiled kernels; made once, whatever of them are called.

        Raises BackendError for what is not finite, and for more pixels on a side than they draw.
        """
        from ringlight import _kernels

        if not (1 <= self.width <= MAX_IMAGE_SIDE and 1 <= self.height <= MAX_IMAGE_SIDE):
            raise BackendError(
                f"the kernels draw images of 1 to {MAX_IMAGE_SIDE} pixels a side, not {self.width} x {self.height}; "
                "ask for smaller ones (--downscale of photographs, --width of pictures)"
            )
        self.refuse_if_not_finite()
        pose, position = (tensor.detach().float().contiguous() for tensor in (self.world_to_camera, self.position))
        return _kernels.Camera(
            world_to_camera=pose,
            position=position,
            focal=self.focal,
            center=self.center,
            width=self.width,
            height=self.height,
        )

    def refuse_if_not_finite(self) -> None:
        """Raise BackendError where the pose or the lens is no finite number."""
        lens = torch.tensor([*self.focal, *self.center])
        for what, values in (("camera's pose", self.world_to_camera), ("lens", lens)):
            if not values.isfinite().all():
                raise BackendError(f"the {what} holds a value that is not finite; only finite numbers can be drawn")

    @computed_once
    def forward(self) -> Float[Tensor, "3"]:
        """Unit viewing axis in world coordinates."""
        return self.world_to_camera[2, :3].contiguous()

    def depths(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """Camera z of world points, world units; negative behind the camera."""
        matrix = self.world_to_camera.to(points)
        return points @ matrix[2, :3] + matrix[2, 3]

    def pixels(self, points: Float[Tensor, "N 3"]) -> tuple[Int[Tensor, "N"], Int[Tensor, "N"], Bool[Tensor, "N"]]:
        """Column and row of the pixel that each world point lies in, and whether it is in the picture, in front."""
        matrix = self.world_to_camera.to(points)
        x, y, z = (points @ matrix[:3, :3].T + matrix[:3, 3]).unbind(-1)
        column = (self.focal[0] * x / z + self.center[0]).floor().long()
        row = (self.focal[1] * y / z + self.center[1]).floor().long()
        inside = (z > 0) & (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return column, row, inside

    def ray_directions(self) -> Float[Tensor, "H W 3"]:
        """Unit world directions through the pixel centres."""
        x = (torch.arange(self.width) + 0.5 - self.center[0]) / self.focal[0]
        y = (torch.arange(self.height) + 0.5 - self.center[1]) / self.focal[1]
        rows, columns = torch.meshgrid(y, x, indexing="ij")
        directions = torch.stack([columns, rows, torch.ones_like(columns)], -1)
        return torch.nn.functional.normalize(directions, dim=-1) @ self.world_to_camera[:3, :3]

    def resized(self, width: int, height: int) -> "Camera":
        """The same view sampled on another pixel grid."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            focal=(self.focal[0] * sx, self.focal[1] * sy),
            center=(self.center[0] * sx, self.center[1] * sy),
            width=width,
            height=height,
        )


def picture_sizes(cameras: Sequence[Camera], between: str) -> str:
    """The size of all pictures in pixels, as "400x400", or the smallest and the largest with ``between`` in between."""
    sizes = sorted({(camera.width, camera.height) for camera in cameras})
    return between.join(dict.fromkeys(f"{width}x{height}" for width, height in (sizes[0], sizes[-1])))
