"""The mean opacity, so that Gaussians that the photographs do not need die (3DGS-MCMC, section 3.4)."""

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model

LOGITS = "columns.opacity_logits"


class MeanOpacity(EveryStep):
    """``weight`` times the mean of sigmoid(opacity logits)."""

    buffers: tuple[str, ...] = ()

    def __init__(self, weight: float):
        self.weight = weight

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        opacities = model.get_parameter(LOGITS).sigmoid()
        share = self.weight / max(len(opacities), 1)
        gradient = torch.ops.aten.sigmoid_backward(torch.full_like(opacities, share), opacities)
        return Term(self.weight * opacities.mean(), grad_parameters={LOGITS: gradient})
