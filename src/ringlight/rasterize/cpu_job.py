"""One view for the compiled kernels: what they are given, and the sentence where they refuse it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY
from ringlight.core.rendering import Footprint
from ringlight.errors import BackendError
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.finite import refuse_if_not_finite

try:
    from ringlight import _kernels
except ImportError:  # the rasterizer's constructor says what to do about it
    _kernels = None  # type: ignore[assignment]


def check(columns: Sequence[Tensor | None], camera: Camera) -> None:
    """Refuse in a sentence what the kernels would refuse in a signature."""
    for column in columns:
        if column is not None and (column.dtype != torch.float32 or not column.is_cpu):
            raise BackendError(
                f"the cpu rasterizer draws float32 tensors on the CPU, not {column.dtype} on {column.device}; "
                "move the model there, or choose the rasterizer of its device"
            )
    if not (1 <= camera.width <= _kernels.MAX_IMAGE_SIDE and 1 <= camera.height <= _kernels.MAX_IMAGE_SIDE):
        raise BackendError(
            f"the cpu rasterizer draws images of 1 to {_kernels.MAX_IMAGE_SIDE} pixels a side, "
            f"not {camera.width} x {camera.height}; downscale the camera"
        )


@contextmanager
def refusals_named(columns: Sequence[Tensor | None], camera: Camera, background: Tensor) -> Iterator[None]:
    """The kernels only count what is not finite, in passing; this says where it is."""
    try:
        yield
    except ValueError:
        names = (*GEOMETRY, "opacity_factor", "channels")
        refuse_if_not_finite(dict(zip(names, columns, strict=True)), camera, background)
        raise


class Job:
    """One view to draw: everything about it that has no gradient, and the arrays that it is drawn into."""

    def __init__(self, camera: Camera, background: Tensor, options: RasterOptions, count: int) -> None:
        self.camera = camera.native
        self.settings = _kernels.RasterSettings(
            options.eps2d, options.near, options.max_alpha, options.antialiased, options.absgrad
        )
        self.absgrad = options.absgrad
        self.size = (camera.height, camera.width)
        self.background = background.detach().float().contiguous()
        # Type and device are the background's: torch's defaults may be others.
        self.footprint = Footprint(self.background.new_empty(count, 2), self.background.new_empty(count, 2))

    def table(self, columns: Sequence[Any]) -> "_kernels.SplatTable":
        """The columns as the kernels take them: means, log_scales, quats, opacity_logits, opacity_factor, channels."""
        means, log_scales, quats, opacity_logits, opacity_factor, channels = columns
        return _kernels.SplatTable(means, log_scales, quats, opacity_logits, opacity_factor, channels, self.background)

    def draw(
        self,
        workspace: "_kernels.Workspace",
        table: "_kernels.SplatTable",
        late: "_kernels.LazyColors | None" = None,
        shader: "_kernels.PictureShader | None" = None,
        blended: Tensor | None = None,
        early_stop: bool = False,
    ) -> tuple[Tensor, Tensor]:
        """The planar image [C H W], or of a ``shader``'s colours [3 H W], and alpha [H W]; fills in the footprint.

        ``late`` goes before the table's channels. ``blended`` [C H W] keeps what the shader was given. With
        ``early_stop`` the last 1/64 of a pixel's light may be what lies in front of it, with alpha 1, and there is no
        backward pass.
        """
        planes = len(self.background) if shader is None else 3
        image, alpha = self.background.new_empty(planes, *self.size), self.background.new_empty(self.size)
        marks = (self.footprint.means2d, self.footprint.radii)
        try:
            workspace.forward(
                table, self.camera, self.settings, image, alpha, *marks, late, shader, blended, early_stop
            )
        except MemoryError as error:
            size, count = f"{self.size[1]} x {self.size[0]}", len(self.footprint.radii)
            raise BackendError(
                f"{count} Gaussians on {size} pixels need more memory, or more time, than a view may take; "
                "they cover too much of the image: make the scales, the image or their number smaller"
            ) from error
        return image, alpha

    def note(self, gradient: Tensor, absolute: Tensor | None) -> None:
        """Add what one backward pass found to the footprint, as torch adds to ``grad``."""
        footprint = self.footprint
        known, known_absolute = footprint.means2d_gradient, footprint.absolute_gradient
        footprint.means2d_gradient = gradient if known is None else known + gradient
        if absolute is not None:
            footprint.absolute_gradient = absolute if known_absolute is None else known_absolute + absolute


def as_raster(image: Float[Tensor, "C H W"], alpha: Float[Tensor, "H W"]) -> tuple[Tensor, Tensor]:
    """The same memory as the contract has it."""
    return image.permute(1, 2, 0), alpha.unsqueeze(-1)
