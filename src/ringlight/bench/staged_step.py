"""One training step cut into stages, so that each can be timed alone: the arithmetic of ``fit.train.train``."""

from collections.abc import Callable

from ringlight.bench.seams import seams_of, shades
from ringlight.core.rendering import Rendering
from ringlight.fit.losses import photometric_gradient
from ringlight.fit.train import Training


class StagedStep:
    """The stages of one step; those of the shader only where it does anything.

    A whole step shades tiles while they are blended, where it can: there the stages add up to more than the step.
    """

    def __init__(self, training: Training, step: int):
        self.training, self.step = training, step
        self.seams = seams_of(training)

    def stages(self) -> dict[str, Callable[[], object]]:
        """What to run, in order."""
        seams = self.seams
        stages: dict[str, Callable[[], object]] = {
            "photograph": self.photograph,
            "colour forward": lambda: seams.colour_forward(self.batch),
            "raster forward": seams.raster_forward,
            "shade forward": seams.shade_forward,
            "loss": self.loss,
            "shade backward": lambda: seams.shade_backward(self.by_color),
            "raster backward": seams.raster_backward,
            "colour backward": seams.colour_backward,
            "adam": self.adam,
            "strategies": self.strategies,
        }
        if shades(self.training):
            return stages
        joined = {
            "raster forward": lambda: (seams.raster_forward(), stages["shade forward"]()),
            "raster backward": lambda: (stages["shade backward"](), seams.raster_backward()),
        }
        return {name: joined.get(name, stage) for name, stage in stages.items() if not name.startswith("shade")}

    def photograph(self) -> None:
        fixed = self.training.batches.scene.background != "random"
        self.batch = self.training.batches.at(self.step)
        self.target = self.training.targets.of(self.batch, fixed)

    def loss(self) -> None:
        _, self.by_color = photometric_gradient(self.seams.color, self.target, self.training.loss)

    def adam(self) -> None:
        radii = self.seams.raster.footprint.radii
        self.training.optimizer.step(self.step, radii, self.seams.gradients)

    def strategies(self) -> None:
        raster = self.seams.raster
        rendering = Rendering(self.seams.color, raster.alpha, {}, raster)
        for strategy in self.training.strategies:
            strategy.update(self.step, self.training.model, self.training.optimizer, rendering)
