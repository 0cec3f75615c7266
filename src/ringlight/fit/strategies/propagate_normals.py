"""Normal propagation and colour sabotage (3DGS-DR, Ye et al. 2024, section 4.3).

A normal learns only from reflections that are nearly right already. Where a few Gaussians have found theirs, larger
ones cover their neighbours, which then learn from them; opaque ones take part at all.
"""

import math
from collections.abc import Callable, Collection

import torch
from torch import Tensor

from ringlight.color.reflective_harmonics import FIRST_STRENGTH, STRENGTHS
from ringlight.core.gradients import COLUMNS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.propagation_settings import PropagationSettings
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel

OPACITIES, SCALES, CONSTANT, REFLECTIONS = (
    COLUMNS + name for name in ("opacity_logits", "log_scales", "sh_dc", STRENGTHS)
)

LEAST_LOGIT = math.log(FIRST_STRENGTH / (1 - FIRST_STRENGTH))
"""Of a strength after a reset, that with which the paper's Gaussians start: so none is lost for good."""


class PropagateNormals(Stateless):
    """A round after each of the steps ``rounds``, but where ``resets`` says that density control lowers the opacities.

    There every strength is raised to that of LEAST_LOGIT.
    """

    def __init__(
        self, settings: PropagationSettings, rounds: Collection[int], resets: Callable[[int], bool], seed: int
    ):
        self.settings, self.rounds, self.resets, self.seed = settings, frozenset(rounds), resets, seed

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        columns = {name: model.get_parameter(name).detach() for name in (OPACITIES, SCALES, CONSTANT, REFLECTIONS)}
        if self.resets(step):
            optimizer.replace(REFLECTIONS, columns[REFLECTIONS].clamp_min(LEAST_LOGIT))
        elif step in self.rounds:
            self._round(step, columns, optimizer)

    def _round(self, step: int, columns: dict[str, Tensor], optimizer: Optimizer) -> None:
        strengths, settings = columns[REFLECTIONS].sigmoid(), self.settings
        faintest = math.log(settings.opacity / (1 - settings.opacity))
        optimizer.replace(OPACITIES, columns[OPACITIES].clamp_min(faintest))
        reflective, dull = (strengths > settings.reflective)[:, None], (strengths < settings.dull)[:, None]
        optimizer.replace(SCALES, torch.where(reflective, _wider(columns[SCALES], settings.enlarge), columns[SCALES]))
        constant = columns[CONSTANT]
        drawn = torch.rand(constant.shape, generator=generator(self.seed, step, "sabotage")).to(constant)
        optimizer.replace(CONSTANT, torch.where(dull, constant + (2 * drawn - 1) * settings.sabotage, constant))


def _wider(log_scales: Tensor, factor: float) -> Tensor:
    """All axes but the shortest ``factor`` times as long; [N 3]."""
    shortest = torch.nn.functional.one_hot(log_scales.argmin(-1), 3).to(torch.bool)
    return torch.where(shortest, log_scales, log_scales + math.log(factor))
