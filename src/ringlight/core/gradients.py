"""Gradients that are cheaper to use than to write down."""

from typing import Protocol, runtime_checkable

from torch import Tensor

AdamStep = tuple[float, float, float, float, int]
"""Rate, both betas, epsilon, and the number of the update, 1 for the first."""


@runtime_checkable
class FactoredGradient(Protocol):
    """The gradient of one parameter as the factors that it is made of, valid until the model changes."""

    def dense(self) -> Tensor:
        """The gradient itself, shaped like the parameter."""
        ...

    def adam_(self, value: Tensor, mean: Tensor, square: Tensor, step: AdamStep) -> int:
        """One update of the parameter and its moments in place, with the same bits as one by :meth:`dense`.

        Elements that would not be finite afterwards are left as they are; returns how many those are.
        """
        ...


Gradient = Tensor | FactoredGradient
