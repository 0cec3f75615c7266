"""The socket: a term of the loss that looks at the model, or at buffers such as depth, normals and alpha."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Channels, Rendering
from ringlight.models.contract import Model


@dataclass(frozen=True)
class Term:
    """The value, with its weight, and its gradients: by buffer, and by full parameter name."""

    value: Float[Tensor, ""]
    grad_buffers: Channels = field(default_factory=dict)
    grad_parameters: Mapping[str, Tensor] = field(default_factory=dict)


@runtime_checkable
class Regularizer(Protocol):
    """Costs no more than its own arithmetic: the step takes the same road with it and without."""

    buffers: tuple[str, ...]
    """What it looks at of a prediction, by name; a model that does not blend them is refused when a run is built."""

    def looks(self, step: int) -> bool:
        """Whether it has a say at this step; where it has none nothing is blended for it. See :class:`EveryStep`."""
        ...

    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """Value and gradients at this step, without a graph."""
        ...


class EveryStep:
    """What most regularizers are."""

    def looks(self, step: int) -> bool:
        """Yes: see :class:`Regularizer`."""
        return True
