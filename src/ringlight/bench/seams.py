"""Where a step's drawing is cut for timing: between colour and rasterizer, with autograd and without."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gradients import Gradient
from ringlight.core.rendering import OPACITY_FACTOR, Raster
from ringlight.data.batches import ImageBatch
from ringlight.fit.train import Training, direct_model
from ringlight.models.direct import DirectModel


def seams_of(training: Training) -> "DirectSeams | AutogradSeams":
    """Those of the path that :func:`ringlight.fit.train.train` takes: four stages, to be run in order."""
    direct = direct_model(training)
    return AutogradSeams(training) if direct is None else DirectSeams(training, direct)


class DirectSeams:
    """The parts called one after the other, as :class:`ringlight.models.direct.DirectModel` does."""

    raster: Raster
    gradients: dict[str, Gradient] | None = None

    def __init__(self, training: Training, model: DirectModel):
        self._training, self._direct = training, model

    def colour_forward(self, batch: ImageBatch) -> None:
        self._table = self._training.model.gaussians
        self._colors = self._direct.color.draw(self._table, batch.camera)

    def raster_forward(self, batch: ImageBatch) -> None:
        options = self._training.model.options
        self.raster = self._direct.rasterize.draw(self._table, self._colors, batch.camera, batch.background, options)

    def raster_backward(self, by_image: Float[Tensor, "H W 3"]) -> None:
        self._by_geometry, self._by_colors = self._direct.rasterize.differentiate(by_image)

    @torch.no_grad()
    def colour_backward(self) -> None:
        by_means = self._by_geometry["means"]
        self.gradients = {**self._by_geometry, **self._direct.color.differentiate(self._by_colors, by_means)}


class AutogradSeams:
    """Autograd is cut in two: colour and rasterizer are differentiated by themselves, the chain by hand."""

    raster: Raster
    gradients: dict[str, Gradient] | None = None

    def __init__(self, training: Training):
        self._training = training

    def colour_forward(self, batch: ImageBatch) -> None:
        model = self._training.model
        self._table = model.gaussians
        self._channels = dict(model.color.channels(self._table, batch.camera))

    def raster_forward(self, batch: ImageBatch) -> None:
        model = self._training.model
        self._cuts = {name: values.detach().requires_grad_() for name, values in self._channels.items()}
        factor = self._cuts.get(OPACITY_FACTOR)
        self.raster = model.rasterize(
            self._table, self._cuts["rgb"], batch.camera, batch.background, model.options,
            None if factor is None else factor[:, 0],
        )  # fmt: skip

    def raster_backward(self, by_image: Float[Tensor, "H W 3"]) -> None:
        self.raster.image.backward(by_image)

    def colour_backward(self) -> None:
        """Also the terms of the loss that look at the model alone."""
        ends = [name for name, values in self._channels.items() if values.requires_grad]
        torch.autograd.backward([self._channels[name] for name in ends], [self._cuts[name].grad for name in ends])
        for penalty in self._training.penalties.values():
            term = penalty(self._training.model)
            if term.requires_grad:
                term.backward()
