"""The CUDA back end for tests that think of the CPU: moves what goes in there, and what comes out here."""

from dataclasses import replace

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Footprint, Raster
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.contract import RasterOptions


class RasterizerOnGpu:
    """As the cuda rasterizer, for tensors on the CPU."""

    name = "cuda"
    device = torch.device("cpu")

    def __init__(self) -> None:
        self.there = rasterizer_for("cuda")
        self.gsplat = self.there.gsplat

    def __call__(
        self,
        gaussians: Gaussians,
        channels: Tensor,
        camera: Camera,
        background: Tensor,
        options: RasterOptions = RasterOptions(),
        opacity_factor: Tensor | None = None,
    ) -> Raster:
        columns = {name: column.cuda() for name, column in gaussians.columns().items()}
        factor = None if opacity_factor is None else opacity_factor.cuda()
        raster = self.there(Gaussians.from_columns(columns), channels.cuda(), camera, background, options, factor)
        return replace(raster, image=raster.image.cpu(), alpha=raster.alpha.cpu(), footprint=_Here(raster.footprint))


class _Here(Footprint):
    """A footprint whose tensors are copied when they are asked for: the backward pass fills some in later."""

    def __init__(self, there: Footprint):
        self._there = there

    def __getattribute__(self, name: str) -> object:
        if name in ("means2d", "radii", "means2d_gradient", "absolute_gradient"):
            value = getattr(object.__getattribute__(self, "_there"), name)
            return None if value is None else value.cpu()
        return object.__getattribute__(self, name)
