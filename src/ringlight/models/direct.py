"""A splat model's picture and gradient without autograd, where every part can differentiate itself."""

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.contract import DirectColor
from ringlight.core.camera import Camera
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import Rendering
from ringlight.rasterize.contract import DirectRasterizer

if TYPE_CHECKING:
    from ringlight.models.splats import SplatModel


class DirectModel:
    """One view at a time: :meth:`render`, then :meth:`differentiate`. The same bits as autograd's."""

    def __init__(self, model: "SplatModel", color: DirectColor, rasterize: DirectRasterizer):
        self.color, self.rasterize = color, rasterize
        self._model = model

    @torch.no_grad()
    def render(self, camera: Camera, background: Float[Tensor, "3"]) -> Rendering:
        """What the model's own ``render`` gives."""
        gaussians = self._model.gaussians
        colors = self.color.draw(gaussians, camera)
        raster = self.rasterize.draw(gaussians, colors, camera, background, self._model.options)
        return Rendering(raster.image, raster.alpha, {"rgb": raster.image, "alpha": raster.alpha}, raster)

    @torch.no_grad()
    def differentiate(self, by_color: Float[Tensor, "H W 3"]) -> dict[str, Gradient]:
        """Gradients by column, for the last view rendered."""
        by_geometry, by_channels = self.rasterize.differentiate(by_color)
        return by_geometry | self.color.differentiate(by_channels, by_geometry["means"])
