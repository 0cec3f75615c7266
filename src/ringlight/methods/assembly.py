"""From the parts of a method that splats Gaussians to its model and its training: what all such methods do alike."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch

from ringlight.color.contract import ColorModel
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud, Scene
from ringlight.data.batches import ImageBatches
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.density_control import density_control
from ringlight.fit.strategies.unlock import Unlock
from ringlight.fit.train import Training
from ringlight.models.initial import INITIAL_OPACITY, gaussians_from_points
from ringlight.models.splats import SplatModel
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.shade.contract import Shader


@dataclass(frozen=True)
class Parts:
    """What a picture is made with, but for the Gaussians."""

    color: ColorModel
    shader: Shader
    antialiased: bool

    def around(self, gaussians: Gaussians, rasterize: Rasterizer) -> SplatModel:
        """The model of this table."""
        return SplatModel(gaussians, self.color, self.shader, rasterize, RasterOptions(antialiased=self.antialiased))

    def empty(self, rasterize: Rasterizer) -> SplatModel:
        """The model without a Gaussian: what a file's tensors are loaded into."""
        with torch.device("cpu"):  # whoever wants only shapes asks for the networks on torch's meta device
            none = PointCloud(torch.zeros(0, 3), torch.zeros(0, 3))
            table = Gaussians(none.positions, torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0))
            columns = table.columns() | self.color.new_columns(none)
        return self.around(Gaussians.from_columns(columns), rasterize)


@dataclass(frozen=True, kw_only=True)
class Course:
    """How the parts are trained. ``groups`` are Adam's by parameter name; ``unlocks`` are the buffers that begin at
    zero, and what each becomes at which step; ``last`` comes after density control."""

    steps: int
    groups: Mapping[str, Adam]
    loss: PhotometricLoss
    densify: DensifySettings
    unlocks: Mapping[str, Mapping[int, int]]
    visible_only: bool = False
    opacity: float = INITIAL_OPACITY
    coarse_steps: int = 0
    last: tuple[Strategy, ...] = ()
    regularizers: Mapping[str, Regularizer] = field(default_factory=dict)


def assembled(
    parts: Parts, course: Course, points: PointCloud, scene: Scene, rasterize: Rasterizer, seed: int
) -> Training:
    """The model at its start, a Gaussian on each of the ``points``, and everything that trains it."""
    model = parts.around(gaussians_from_points(points, parts.color, course.opacity), rasterize)
    for buffer in course.unlocks:
        model.get_buffer(buffer).zero_()
    return Training(
        model=model,
        batches=ImageBatches(scene, seed, course.coarse_steps),
        loss=PhotographLoss(course.loss, rasterize.device),
        optimizer=Optimizer(model, course.groups, course.steps, course.visible_only),
        strategies=(
            *(Unlock(buffer, schedule) for buffer, schedule in course.unlocks.items()),
            *density_control(course.densify, scene, course.steps, seed),
            *course.last,
        ),
        steps=course.steps,
        regularizers=course.regularizers,
    )
