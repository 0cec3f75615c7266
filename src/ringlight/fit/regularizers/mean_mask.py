"""The mean visibility mask, so that Gaussians that the photographs do not need are masked (Compact 3DGS, eq. 5)."""

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model

MASK = "columns.mask_logits"


class MeanMask(EveryStep):
    """``weight`` times the mean of sigmoid(mask logits)."""

    buffers: tuple[str, ...] = ()

    def __init__(self, weight: float):
        self.weight = weight

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        soft = model.get_parameter(MASK).sigmoid()
        share = self.weight / max(len(soft), 1)
        gradient = torch.ops.aten.sigmoid_backward(torch.full_like(soft, share), soft)
        return Term(self.weight * soft.mean(), grad_parameters={MASK: gradient})
