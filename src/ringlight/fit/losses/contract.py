"""The socket: what a prediction is compared with."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Rendering


@dataclass(frozen=True)
class Compared:
    """Value of the loss, and the gradient with which the way back begins; ``truth`` is what the colours should have
    been, in [0, 1]."""

    value: Float[Tensor, ""]
    grad_color: Float[Tensor, "*pixels 3"]
    truth: Float[Tensor, "*pixels 3"]


@runtime_checkable
class Loss(Protocol):
    """Knows the kind of batch that it is given."""

    @property
    def bytes_kept(self) -> int:
        """What lies in memory from step to step, of photographs as this loss wants them."""
        ...

    def compare(self, prediction: Rendering, batch: Any) -> Compared:
        """Value and gradient, without a graph."""
        ...
