"""The compiled kernels without anything around them: no autograd, no checks, arrays made once and used again."""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.fit.losses import Target
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam
from ringlight.rasterize.contract import RasterOptions


class RasterKernel:
    """Forward and backward pass of one view. ``image`` [C H W] and the gradients are overwritten each time."""

    def __init__(
        self,
        table: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        opacity_factor: Float[Tensor, "N"] | None = None,
    ):
        columns = [getattr(table, name).detach().contiguous() for name in GEOMETRY]
        factor = None if opacity_factor is None else opacity_factor.detach().contiguous()
        channels = channels.detach().contiguous()
        size = (camera.height, camera.width)
        self.image, self._alpha = channels.new_empty(channels.shape[1], *size), channels.new_empty(size)
        self._footprint = (channels.new_empty(len(table), 2), channels.new_empty(len(table), 2))
        means, log_scales, quats, opacity_logits = columns
        self._table = _kernels.SplatTable(means, log_scales, quats, opacity_logits, factor, channels, background)
        self._camera = camera.native
        self._settings = _kernels.RasterSettings(
            options.eps2d, options.near, options.max_alpha, options.antialiased, options.absgrad
        )
        by_factor = None if factor is None else torch.empty_like(factor)
        absolute = channels.new_empty(len(table), 2) if options.absgrad else None
        self.gradients = {name: torch.empty_like(column) for name, column in zip(GEOMETRY, columns, strict=True)}
        by_means, by_scales, by_quats, by_opacities = self.gradients.values()
        by_channels, by_center = torch.empty_like(channels), channels.new_empty(len(table), 2)
        self._gradients = _kernels.SplatGradients(
            by_means, by_scales, by_quats, by_opacities, by_factor, by_channels, by_center, absolute
        )
        self._workspace = _kernels.Workspace()

    def forward(self) -> None:
        self._workspace.forward(self._table, self._camera, self._settings, self.image, self._alpha, *self._footprint)

    def backward(self, by_image: Float[Tensor, "C H W"]) -> None:
        self._workspace.backward(self._table, self.image, by_image, None, self._gradients)

    @property
    def stage_seconds(self) -> dict[str, float]:
        """How long each stage took the last time, in order."""
        return self._workspace.stage_seconds

    def count_pairs(self) -> tuple[int, int]:
        """Pairs of Gaussian and pixel that a forward pass evaluates and blends; slow."""
        self.forward()
        return self._workspace.count_pairs()


class LossKernel:
    """Value and gradient of the photometric loss of one image; ``gradient`` is overwritten each time."""

    def __init__(
        self,
        image: Float[Tensor, "3 H W"],
        target: Target,
        settings: PhotometricLoss,
        gradient: Float[Tensor, "3 H W"] | None = None,
    ):
        _, height, width = image.shape
        self.gradient = torch.empty_like(image) if gradient is None else gradient
        workspace = image.new_empty(_kernels.photometric_workspace(height, width, _kernels.threads()))
        weights = (settings.scale * (1 - settings.ssim_weight), settings.scale * settings.ssim_weight)
        blurs = (target.blur, target.square_blur)
        self._arguments = (image, target.image, *blurs, self.gradient, workspace, *weights, settings.pixel == "l2")

    def run(self) -> float:
        return _kernels.photometric(*self._arguments)


class AdamKernel:
    """One update of copies of the parameters, again and again."""

    def __init__(self, parameters: Sequence[Tensor], gradients: Sequence[Tensor], groups: Sequence[Adam]):
        self._values, self._gradients = [parameter.detach().clone() for parameter in parameters], list(gradients)
        self._means, self._squares = ([torch.zeros_like(value) for value in self._values] for _ in range(2))
        # Far into a run, where both moments are warm.
        self._steps = [(group.rate.at(0.5), *group.betas, group.epsilon, 1000) for group in groups]

    def run(self) -> None:
        _kernels.adam(self._values, self._gradients, self._means, self._squares, self._steps)


def gradients_like(parameters: Mapping[str, Tensor], known: Mapping[str, Tensor]) -> list[Tensor]:
    """The known gradients by name, and for the other parameters arrays of a gradient's usual size."""
    return [known.get(name, torch.full_like(parameter, 1e-4)) for name, parameter in parameters.items()]
