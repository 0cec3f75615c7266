"""The mean standard deviation, so that Gaussians that the photographs do not need vanish (3DGS-MCMC, section 3.4)."""

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model

LOG_SCALES = "columns.log_scales"


class MeanScale(EveryStep):
    """``weight``, in one over world units, times the mean of exp(log scales) over all rows and axes."""

    buffers: tuple[str, ...] = ()

    def __init__(self, weight: float):
        self.weight = weight

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        scales = model.get_parameter(LOG_SCALES).exp()
        gradient = scales * (self.weight / max(scales.numel(), 1))
        return Term(self.weight * scales.mean(), grad_parameters={LOG_SCALES: gradient})
