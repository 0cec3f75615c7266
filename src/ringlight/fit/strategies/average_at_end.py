"""The model that is kept is the mean of those of a run's last steps: what single steps add to it is noise.

Izmailov, Podoprikhin, Garipov, Vetrov, Wilson: Averaging Weights Leads to Wider Optima and Better Generalization, UAI
2018.
"""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer


class AverageAtEnd:
    """The mean of all parameters after steps ``first`` to ``last``, which take its values then. They must keep their
    shapes meanwhile. Until then training goes on with the values of single steps, and so do previews."""

    most: int | None = None

    def __init__(self, first: int, last: int):
        self.first, self.last = first, last
        self._share = (last - first + 1) / last
        self._means: dict[str, Tensor] = {}

    def extend(self, added: int) -> None:
        """See :class:`ringlight.fit.strategies.contract.AtTheEnd`. Of the added steps the same share counts, since
        rates fall once more over these; never one that is done."""
        self.last += added
        self.first = self.last - max(round(self._share * added), 1) + 1

    @torch.no_grad()
    def update(self, step: int, model: nn.Module, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if not self.first <= step <= self.last:
            return
        parameters = dict(model.named_parameters())
        if step == self.first:
            self._means = {name: parameter.detach().clone() for name, parameter in parameters.items()}
        else:
            share = 1 / (step - self.first + 1)
            self._means = {
                name: mean.to(parameters[name]).lerp_(parameters[name], share) for name, mean in self._means.items()
            }
        if step == self.last:
            for name, mean in self._means.items():
                parameters[name].copy_(mean)
            self._means = {}

    def state(self) -> dict[str, Tensor]:
        return dict(self._means)

    def restore(self, state: Mapping[str, Tensor]) -> None:
        self._means = {name: mean.clone() for name, mean in state.items()}  # moved by the next step
