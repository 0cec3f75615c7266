"""Columns that are kept small: residuals that explain only what nothing else does."""

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model


class SmallColumn(EveryStep):
    """``weight`` times the mean over rows of the squared length of one parameter, by its full name."""

    buffers: tuple[str, ...] = ()

    def __init__(self, name: str, weight: float):
        self.name, self.weight = name, weight

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        column = model.get_parameter(self.name).detach()
        share = self.weight / max(len(column), 1)
        return Term(share * column.square().sum(), grad_parameters={self.name: 2 * share * column})
