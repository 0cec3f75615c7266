"""One training step cut into stages, so that each can be timed alone: the arithmetic of ``fit.train.train``."""

from collections.abc import Callable

from ringlight.bench.seams import seams_of
from ringlight.core.rendering import Rendering
from ringlight.fit.losses import photometric_gradient
from ringlight.fit.train import Training


class StagedStep:
    """For models whose shader passes the blended colour through."""

    def __init__(self, training: Training, step: int):
        self.training, self.step = training, step
        self.seams = seams_of(training)

    def stages(self) -> dict[str, Callable[[], object]]:
        """What to run, in order."""
        return {
            "photograph": self.photograph,
            "colour forward": lambda: self.seams.colour_forward(self.batch),
            "raster forward": lambda: self.seams.raster_forward(self.batch),
            "loss": self.loss,
            "raster backward": lambda: self.seams.raster_backward(self.by_image),
            "colour backward": lambda: self.seams.colour_backward(),
            "adam": self.adam,
            "strategies": self.strategies,
        }

    def photograph(self) -> None:
        fixed = self.training.batches.scene.background != "random"
        self.batch = self.training.batches.at(self.step)
        self.target = self.training.targets.of(self.batch, fixed)

    def loss(self) -> None:
        _, self.by_image = photometric_gradient(self.seams.raster.image, self.target, self.training.loss)

    def adam(self) -> None:
        radii = self.seams.raster.footprint.radii
        self.training.optimizer.step(self.step, radii, self.seams.gradients)

    def strategies(self) -> None:
        raster = self.seams.raster
        rendering = Rendering(raster.image, raster.alpha, {}, raster)
        for strategy in self.training.strategies:
            strategy.update(self.step, self.training.model, self.training.optimizer, rendering)
