"""A splat model's picture and gradient without autograd, where every part can differentiate itself."""

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.contract import DirectColor
from ringlight.core.camera import Camera
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import Channels, Raster, Rendering
from ringlight.rasterize.contract import DirectRasterizer
from ringlight.shade.contract import DirectShader

if TYPE_CHECKING:
    from ringlight import _kernels
    from ringlight.models.splats import SplatModel

SHADER_PREFIX = "shader."
"""Names of the shader's parameters in the model begin with this."""


ImageGradients = tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"] | None, dict[str, Tensor]]
"""By the blended channels, by alpha, and by the shader's parameters."""


def unshaded(by_color: Float[Tensor, "H W 3"]) -> ImageGradients:
    """What a :class:`ringlight.shade.contract.DirectShader` that hands "rgb" on would find."""
    return by_color, None, {}


class DirectModel:
    """One view at a time: :meth:`render`, then :meth:`differentiate`. The same bits as autograd's.

    ``shader`` is None where the blended "rgb" is the colour.
    """

    def __init__(
        self, model: "SplatModel", color: DirectColor, rasterize: DirectRasterizer, shader: DirectShader | None
    ):
        self.color, self.rasterize, self.shader = color, rasterize, shader
        self._model = model

    @torch.no_grad()
    def render(self, camera: Camera, background: Float[Tensor, "3"]) -> Rendering:
        """What the model's own ``render`` gives."""
        tiles = None if self.shader is None else self.shader.tiles(camera, background)
        if tiles is not None:
            return self._blend_and_shade(tiles, camera, background)
        channels = self.color.draw(self._model.gaussians, camera, may_be_late=True)
        return self.shade(self.blend(channels, camera, background), camera, background)

    def _blend_and_shade(
        self,
        tiles: "_kernels.PictureShader",
        camera: Camera,
        background: Float[Tensor, "3"],
    ) -> Rendering:
        """Tile by tile, while what was blended is in the cache."""
        assert self.shader is not None
        gaussians, options, factor = self._model.gaussians, self._model.options, self.color.opacity_factor
        channels = self.color.draw(gaussians, camera)
        behind = _behind(channels, background)
        raster, color = self.rasterize.draw_shaded(gaussians, channels, camera, behind, tiles, options, factor)
        buffers = self._buffers(raster)
        self.shader.keep(buffers)
        return Rendering(color, raster.alpha, buffers, raster)

    def _buffers(self, raster: Raster) -> Channels:
        widths = self.color.widths
        parts = raster.image.split(tuple(widths.values()), -1)
        return dict(zip(widths, parts, strict=True)) | {"alpha": raster.alpha}

    def blend(
        self,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "3"],
    ) -> Rendering:
        """The channels last drawn, blended, "rgb" over the background and the others over nothing; ``color`` is still
        "rgb"."""
        behind = _behind(channels, background)
        gaussians, options = self._model.gaussians, self._model.options
        factor, late = self.color.opacity_factor, self.color.late
        try:
            raster = self.rasterize.draw(gaussians, channels, camera, behind, options, factor, late)
        except ValueError:
            if late is None:
                raise
            # A late colour is not finite, most likely: with all of them at hand it can be said which.
            raster = self.rasterize.draw(gaussians, self.color.draw(gaussians, camera), camera, behind, options, factor)
        buffers = self._buffers(raster)
        return Rendering(buffers["rgb"], raster.alpha, buffers, raster)

    def shade(self, blended: Rendering, camera: Camera, background: Float[Tensor, "3"]) -> Rendering:
        """With the shader's colour."""
        if self.shader is None:
            return blended
        color = self.shader.draw(blended.buffers, camera, background)
        return Rendering(color, blended.alpha, blended.buffers, blended.raster)

    @torch.no_grad()
    def differentiate(self, by_color: Float[Tensor, "H W 3"]) -> dict[str, Gradient]:
        """Gradients by column, and of shared parameters by their names in the model, for the last view rendered."""
        by_image, by_alpha, shared = unshaded(by_color) if self.shader is None else self.shader.differentiate(by_color)
        by_geometry, by_channels = self.rasterize.differentiate(by_image, by_alpha)
        by_columns = self.color.differentiate(by_channels, by_geometry)
        return {**by_geometry, **by_columns} | {SHADER_PREFIX + name: gradient for name, gradient in shared.items()}


def _behind(channels: Float[Tensor, "N C"], background: Float[Tensor, "3"]) -> Float[Tensor, "C"]:
    """What the channels are blended over: "rgb" the background, the others nothing."""
    return torch.nn.functional.pad(background, (0, channels.shape[1] - len(background)))
