"""Gradients by parameter name, and those that are cheaper to use than to write down."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from torch import Tensor

AdamStep = tuple[float, float, float, float, int]
"""Rate, both betas, epsilon, and the number of the update, 1 for the first."""

COLUMNS, COLOR, SHADER = "columns.", "color.", "shader."
"""What names of a splat model's parameters begin with: the table's columns, the colour model's, the shader's own."""


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


def dense(gradient: Gradient) -> Tensor:
    """The gradient as one tensor."""
    return gradient if isinstance(gradient, Tensor) else gradient.dense()


class Gradients(dict[str, Gradient]):
    """By full parameter name, as the optimizer, rates and model files know it: ``columns.means``, ``color.ring.core``.

    On the way back each part adds its own; a parameter that had no part in the picture has no gradient.
    """

    def add(self, name: str, gradient: Gradient) -> None:
        """Add to what is there under this name."""
        known = self.get(name)
        self[name] = gradient if known is None else dense(known) + dense(gradient)

    def add_all(self, found: Mapping[str, Gradient]) -> None:
        """The same for several."""
        for name, gradient in found.items():
            self.add(name, gradient)
