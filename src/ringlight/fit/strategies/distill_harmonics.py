"""Narrow the harmonics to a lower degree, and let the model as it was before teach the model as it is then.

LightGaussian (Fan et al. 2023), section 3.3.
"""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.rendering import Rendering
from ringlight.fit.narrowed_harmonics import narrowed_harmonics
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.teacher import Teacher
from ringlight.models.splats import SplatModel

DC, REST = "sh_dc", "sh_rest"


class DistillHarmonics:
    """After step ``first`` the ``teacher`` is a copy of the model, whose harmonics become those of ``degree`` that look
    most like them from the ``cameras``; after step ``last`` the teacher goes. What is cut is zero, and no longer in
    use."""

    most = None

    def __init__(self, teacher: Teacher, first: int, last: int, degree: int, cameras: Sequence[Camera]):
        self.teacher, self.first, self.last, self.degree = teacher, first, last, degree
        self.cameras = cameras

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step == self.first:
            self.teacher.become(model)
            self._cut(model, optimizer)
        if step >= self.first:  # in runs of a few steps degrees are still being switched on
            model.get_buffer("color.active_degree").clamp_(max=self.degree)
        if step == self.last:
            self.teacher.go()

    @torch.no_grad()
    def _cut(self, model: SplatModel, optimizer: Optimizer) -> None:
        means, constant, others = (model.columns[name].detach() for name in ("means", DC, REST))
        dc, rest = narrowed_harmonics(means, constant, others, self.degree, self.cameras)
        optimizer.replace(COLUMNS + DC, dc)
        optimizer.replace(COLUMNS + REST, rest)

    def state(self) -> dict[str, Tensor]:
        return self.teacher.state()

    def restore(self, state: Mapping[str, Tensor]) -> None:
        self.teacher.restore(state)
