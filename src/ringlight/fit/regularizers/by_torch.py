"""Regularizers written as a function of tensors; torch differentiates them."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import EveryStep, Term
from ringlight.models.contract import Model


class TorchRegularizer(EveryStep):
    """``function`` gets parameters by full name and buffers by name, and returns the weighted term."""

    def __init__(
        self,
        function: Callable[[dict[str, Tensor]], Float[Tensor, ""]],
        parameters: Sequence[str] = (),
        buffers: tuple[str, ...] = (),
    ):
        self.function, self.parameters, self.buffers = function, parameters, buffers

    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        inputs = {name: model.get_parameter(name) for name in self.parameters}
        inputs |= {name: prediction.buffers[name] for name in self.buffers}
        recorded = ByAutograd(lambda leaves: {"term": self.function(leaves)}, inputs)
        value = recorded.outputs["term"]
        found = recorded.backward({"term": torch.ones_like(value)})
        of_buffers = {name: gradient for name, gradient in found.items() if name in self.buffers}
        return Term(value, of_buffers, {name: g for name, g in found.items() if name not in of_buffers})
