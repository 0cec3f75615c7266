"""One view for the compiled kernels: what they are given, and the sentence where they refuse it."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import Footprint, TileShading
from ringlight.errors import BackendError
from ringlight.rasterize.contract import RasterOptions

Table = dict[str, Tensor | None]
"""The columns of the geometry by name, "opacity_factor", which may be None, and "channels"."""


def table_of(gaussians: Gaussians, channels: Tensor, opacity_factor: Tensor | None) -> Table:
    """The table as the kernels take it; refuses in a sentence what they would refuse in a signature."""
    columns: Table = {name: getattr(gaussians, name) for name in GEOMETRY}
    columns |= {"opacity_factor": opacity_factor, "channels": channels}
    for column in columns.values():
        if column is not None and (column.dtype != torch.float32 or not column.is_cpu):
            raise BackendError(
                f"the cpu rasterizer draws float32 tensors on the CPU, not {column.dtype} on {column.device}; "
                "move the model there, or choose the rasterizer of its device"
            )
    return {name: None if column is None else column.contiguous().resolve_neg() for name, column in columns.items()}


class Job:
    """One view to draw: everything about it that has no gradient, and the arrays that it is drawn into."""

    def __init__(self, camera: Camera, background: Tensor, options: RasterOptions, count: int) -> None:
        self.camera = camera.native
        self.settings = _kernels.RasterSettings(**vars(options))
        self.absgrad = options.absgrad
        self.size = (camera.height, camera.width)
        self.tile_pixels = self.camera.tile_pixels
        self.background = background.detach().float().contiguous()
        # Type and device are the background's: torch's defaults may be others.
        self.footprint = Footprint(self.background.new_empty(count, 2), self.background.new_empty(count, 2))

    def native(self, table: Table) -> "_kernels.SplatTable":
        """The table for one call."""
        return _kernels.SplatTable(**table, background=self.background)  # type: ignore[arg-type]

    def draw(
        self,
        workspace: "_kernels.Workspace",
        table: Table,
        lazy: "_kernels.LazyColors | None" = None,
        shader: TileShading | None = None,
        blended: Float[Tensor, "C H W"] | None = None,
        tiles: Float[Tensor, "B D 16"] | None = None,
        early_stop: bool = False,
    ) -> tuple[Float[Tensor, "P H W"], Float[Tensor, "H W"]]:
        """The planar image, or of a ``shader``'s colours, and alpha; fills in the footprint.

        ``lazy`` goes before the table's channels. ``blended`` or ``tiles`` keep what the shader was given.
        With ``early_stop`` the last 1/64 of a pixel's light may be what lies in front of it, and there is no way back.
        """
        planes = len(self.background) if shader is None else 3
        image, alpha = self.background.new_empty(planes, *self.size), self.background.new_empty(self.size)
        marks = (self.footprint.means2d, self.footprint.radii)
        try:
            workspace.forward(
                self.native(table), self.camera, self.settings, image, alpha, *marks, lazy,
                None if shader is None else shader.kernel, blended, tiles, early_stop,
            )  # fmt: skip
        except MemoryError as error:
            size, count = f"{self.size[1]} x {self.size[0]}", len(self.footprint.radii)
            raise BackendError(
                f"{count} Gaussians on {size} pixels need more memory, or more time, than a view may take; "
                "they cover too much of the image: make the scales, the image or their number smaller"
            ) from error
        return image, alpha
