"""L1 norm of a volume's density factors, so that space which no photograph needs is empty (TensoRF, equation 6)."""

from collections.abc import Callable, Sequence

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model


class FactorSize(EveryStep):
    """The mean absolute value of each factor, summed, times ``first`` up to step ``until`` and ``rest`` from there.

    ``names`` gives those that density is made of now."""

    buffers: tuple[str, ...] = ()

    def __init__(self, names: Callable[[], Sequence[str]], first: float, rest: float, until: int):
        self.names, self.first, self.rest, self.until = names, first, rest, until

    @torch.no_grad()
    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        weight = self.first if step <= self.until else self.rest
        factors = {name: model.get_parameter(name) for name in self.names()}
        value = sum((factor.abs().mean() for factor in factors.values()), torch.zeros(()).to(model.device))
        gradients = {name: factor.sign().mul_(weight / factor.numel()) for name, factor in factors.items()}
        return Term(weight * value, grad_parameters=gradients)
