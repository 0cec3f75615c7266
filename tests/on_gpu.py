"""The CUDA back end for tests that think of the CPU: moves what goes in there, and what comes out here."""

from dataclasses import replace

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.rendering import Emission, EmissionGradients, Footprint, Raster
from ringlight.core.want import Want
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.contract import RasterOptions


class RasterizerOnGpu:
    """As the cuda rasterizer, for tensors on the CPU."""

    name = "cuda"
    device = torch.device("cpu")
    gradient_tolerance = 1.5e-3
    """gsplat is compiled with the fast exponential, whose error an opaque stack divides by what little light is left:
    1.0e-3 of a column's largest gradient on an H200."""

    def __init__(self) -> None:
        self.there = rasterizer_for("cuda")
        self.gsplat = self.there.gsplat

    @property
    def note(self) -> str | None:
        return self.there.note

    def draw(
        self,
        gaussians: Gaussians,
        emission: Emission,
        camera: Camera,
        background: Tensor,
        options: RasterOptions = RasterOptions(),
        want: Want = Want.EXACT,
        tiles: object = None,
    ) -> Raster:
        columns = {name: column.cuda() for name, column in gaussians.columns().items()}
        factor = None if emission.opacity_factor is None else emission.opacity_factor.cuda()
        moved = Emission(emission.widths, emission.channels.cuda(), factor)
        there = self.there.draw(Gaussians.from_columns(columns), moved, camera, background, options, want)

        def backward(grad_image: Tensor, grad_alpha: Tensor | None, into: Gradients) -> EmissionGradients:
            found = Gradients()
            by_alpha = None if grad_alpha is None else grad_alpha.cuda()
            by_channels, by_factor = there.backward(grad_image.cuda(), by_alpha, found)
            for name, gradient in found.items():
                into.add(name, dense(gradient).cpu())
            return by_channels.cpu(), None if by_factor is None else by_factor.cpu()

        image, alpha, footprint = there.image.cpu(), there.alpha.cpu(), _Here(there.footprint)
        return replace(there, image=image, alpha=alpha, footprint=footprint, backward=backward)


class _Here(Footprint):
    """A footprint whose tensors are copied when they are asked for: the backward pass fills some in later."""

    def __init__(self, there: Footprint):
        self._there = there

    def __getattribute__(self, name: str) -> object:
        if name in ("means2d", "radii", "means2d_gradient", "absolute_gradient"):
            value = getattr(object.__getattribute__(self, "_there"), name)
            return None if value is None else value.cpu()
        return object.__getattribute__(self, name)
