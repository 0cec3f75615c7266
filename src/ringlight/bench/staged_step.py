"""One training step cut at its seams, so that each stage can be timed alone: the arithmetic of ``fit.train.train``."""

from collections.abc import Callable

import torch
from torch import Tensor

from ringlight.core.rendering import OPACITY_FACTOR, Rendering
from ringlight.fit.losses import photometric_gradient
from ringlight.fit.train import Training


class StagedStep:
    """Autograd is cut between colour, rasterizer and loss: each is differentiated by itself, the chain by hand.

    For models whose shader passes the blended colour through.
    """

    def __init__(self, training: Training, step: int):
        self.training, self.step = training, step
        self.geometry: dict[str, Tensor] = {}

    def stages(self) -> dict[str, Callable[[], object]]:
        """What to run, in order."""
        return {
            "photograph": self.photograph,
            "colour forward": self.colour_forward,
            "raster forward": self.raster_forward,
            "loss": self.loss,
            "raster backward": self.raster_backward,
            "colour backward": self.colour_backward,
            "adam": self.adam,
            "strategies": self.strategies,
        }

    def photograph(self) -> None:
        fixed = self.training.batches.scene.background != "random"
        self.batch = self.training.batches.at(self.step)
        self.target = self.training.targets.of(self.batch, fixed)

    def colour_forward(self) -> None:
        self.table = self.training.model.gaussians
        self.channels = dict(self.training.model.color.channels(self.table, self.batch.camera))

    def raster_forward(self) -> None:
        model = self.training.model
        cut = {name: values.detach().requires_grad_() for name, values in self.channels.items()}
        self.rgb, self.factor = cut["rgb"], cut.get(OPACITY_FACTOR)
        factor = None if self.factor is None else self.factor[:, 0]
        self.raster = model.rasterize(
            self.table, self.rgb, self.batch.camera, self.batch.background, model.options, factor
        )

    def loss(self) -> None:
        _, self.by_image = photometric_gradient(self.raster.image, self.target, self.training.loss)

    def raster_backward(self) -> None:
        self.raster.image.backward(self.by_image)

    def colour_backward(self) -> None:
        """Also the terms of the loss that look at the model alone."""
        cuts = {"rgb": self.rgb, OPACITY_FACTOR: self.factor}
        ends = [values for values in self.channels.values() if values.requires_grad]
        slopes = [cuts[name].grad for name, values in self.channels.items() if values.requires_grad]  # type: ignore[union-attr]
        torch.autograd.backward(ends, slopes)
        for penalty in self.training.penalties.values():
            term = penalty(self.training.model)
            if term.requires_grad:
                term.backward()

    def adam(self) -> None:
        self.training.optimizer.step(self.step, self.raster.footprint.radii)

    def strategies(self) -> None:
        raster = self.raster
        rendering = Rendering(raster.image, raster.alpha, {}, raster)
        for strategy in self.training.strategies:
            strategy.update(self.step, self.training.model, self.training.optimizer, rendering)
