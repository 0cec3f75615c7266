"""Where a step's drawing is cut for timing: between colour, rasterizer and shader, with autograd and without."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gradients import Gradient
from ringlight.core.rendering import OPACITY_FACTOR, Channels, Raster
from ringlight.data.batches import ImageBatch
from ringlight.fit.train import Training, direct_model
from ringlight.models.direct import SHADER_PREFIX, DirectModel, unshaded


def seams_of(training: Training) -> "DirectSeams | AutogradSeams":
    """Those of the path that :func:`ringlight.fit.train.train` takes: six stages, to be run in order."""
    direct = direct_model(training)
    return AutogradSeams(training) if direct is None else DirectSeams(training, direct)


def shades(training: Training) -> bool:
    """Whether there is anything to do once a pixel's channels are blended."""
    return not getattr(training.model.shader, "passes_through", False)


class DirectSeams:
    """The parts of :class:`ringlight.models.direct.DirectModel`, called one after the other: shading, too, which that
    does while it blends, where the shader can."""

    raster: Raster
    color: Float[Tensor, "H W 3"]
    gradients: dict[str, Gradient] | None = None

    def __init__(self, training: Training, model: DirectModel):
        self._training, self._direct = training, model

    def colour_forward(self, batch: ImageBatch) -> None:
        self._batch = batch
        self._channels = self._direct.color.draw(self._training.model.gaussians, batch.camera, may_be_late=True)

    @torch.no_grad()
    def raster_forward(self) -> None:
        self._blended = self._direct.blend(self._channels, self._batch.camera, self._batch.background)
        assert self._blended.raster is not None
        self.raster = self._blended.raster

    def shade_forward(self) -> None:
        self.color = self._direct.shade(self._blended, self._batch.camera, self._batch.background).color

    def shade_backward(self, by_color: Float[Tensor, "H W 3"]) -> None:
        shader = self._direct.shader
        found = unshaded(by_color) if shader is None else shader.differentiate(by_color)
        self._by_image, self._by_alpha, self._shared = found

    def raster_backward(self) -> None:
        found = self._direct.rasterize.differentiate(self._by_image, self._by_alpha)
        self._by_geometry, self._by_channels = found

    @torch.no_grad()
    def colour_backward(self) -> None:
        by_columns = self._direct.color.differentiate(self._by_channels, self._by_geometry)
        shared = {SHADER_PREFIX + name: gradient for name, gradient in self._shared.items()}
        self.gradients = {**self._by_geometry, **by_columns, **shared}


class AutogradSeams:
    """Autograd is cut in three: colour, rasterizer and shader are differentiated by themselves, the chain by hand."""

    raster: Raster
    color: Float[Tensor, "H W 3"]
    gradients: dict[str, Gradient] | None = None

    def __init__(self, training: Training):
        self._training = training

    def colour_forward(self, batch: ImageBatch) -> None:
        model = self._training.model
        self._batch, self._table = batch, model.gaussians
        self._channels = dict(model.color.channels(self._table, batch.camera))

    def raster_forward(self) -> None:
        self._cuts = _cut(self._channels)
        channels = dict(self._cuts)
        factor = channels.pop(OPACITY_FACTOR, None)
        batch = self._batch
        self._blended = self._training.model.blend(self._table, channels, factor, batch.camera, batch.background)
        assert self._blended.raster is not None
        self.raster = self._blended.raster

    def shade_forward(self) -> None:
        self._buffers = _cut(self._blended.buffers)
        self.color = self._training.model.shader.shade(self._buffers, self._batch.camera, self._batch.background)

    def shade_backward(self, by_color: Float[Tensor, "H W 3"]) -> None:
        self.color.backward(by_color)

    def raster_backward(self) -> None:
        _go_on(self._blended.buffers, self._buffers)

    def colour_backward(self) -> None:
        """Also the terms of the loss that look at the model alone."""
        _go_on(self._channels, self._cuts)
        for penalty in self._training.penalties.values():
            term = penalty(self._training.model)
            if term.requires_grad:
                term.backward()


def _cut(values: Channels) -> Channels:
    """The same numbers, at which a gradient stops."""
    return {name: value.detach().requires_grad_() for name, value in values.items()}


def _go_on(before: Channels, after: Channels) -> None:
    """The gradients that stopped ``after`` a cut, handed on to what was ``before`` it."""
    ends = [name for name, value in before.items() if value.requires_grad and after[name].grad is not None]
    if ends:
        torch.autograd.backward([before[name] for name in ends], [after[name].grad for name in ends])
