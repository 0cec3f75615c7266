"""Total variation of a volume's factors, so that what few photographs see is smooth (TensoRF, equation 7)."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.by_torch import TorchRegularizer
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model

SCALE = 0.02
"""The published program scales the sum of mean squares so; the paper's weights are those in front of that."""


def variation(factor: Float[Tensor, "..."]) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring nodes of a plane or line, whose last axis are components."""
    axes = range(factor.ndim - 1)
    return sum((factor.diff(dim=axis).square().mean() for axis in axes), factor.new_zeros(()))


class FactorVariation(EveryStep):
    """The variation of each of these factors, summed, times SCALE and ``weight``, of which a share of ``end`` is left
    after ``steps``."""

    buffers: tuple[str, ...] = ()

    def __init__(self, names: Sequence[str], weight: float, steps: int, end: float):
        self.names, self.weight, self.steps, self.end = tuple(names), weight, steps, end

    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        weight = SCALE * self.weight * self.end ** (step / self.steps)

        def weighted(of: dict[str, Tensor]) -> Tensor:
            return weight * sum((variation(of[name]) for name in self.names), torch.zeros(()).to(model.device))

        return TorchRegularizer(weighted, self.names).term(step, model, prediction)
