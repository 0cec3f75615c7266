"""The entropy of the blended alpha, so that pixels show a surface or the background (GaussianShader, section 3.3)."""

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model

LEAST = 1e-3
"""Alpha, and one minus it, are taken to be no less: the entropy has a slope of -ln there, which has no bound."""


class ZeroOne(EveryStep):
    """``weight`` times the mean of -a ln a - (1 - a) ln(1 - a) over all pixels."""

    buffers: tuple[str, ...] = ("alpha",)

    def __init__(self, weight: float):
        self.weight = weight

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        alpha = prediction.buffers["alpha"]
        within = alpha.clamp(LEAST, 1 - LEAST)
        present, absent = within.log(), (-within).log1p()
        value = -(within * present + (1 - within) * absent).mean()
        gradient = (absent - present).mul_(self.weight / alpha.numel()).mul_(within == alpha)
        return Term(self.weight * value, {"alpha": gradient})
