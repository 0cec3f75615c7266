"""The socket: what a prediction is compared with."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Channels, Rendering
from ringlight.models.contract import Model


@dataclass(frozen=True)
class Compared:
    """Value of the loss, and the gradients with which the way back begins: of the colours, by buffer, and by full
    parameter name. ``truth`` is what the colours should have been, in [0, 1]; ``weights`` is how much pixels count that
    were drawn with other chances than even ones."""

    value: Float[Tensor, ""]
    grad_color: Float[Tensor, "*pixels 3"]
    truth: Float[Tensor, "*pixels 3"]
    grad_buffers: Channels = field(default_factory=dict)
    grad_parameters: Mapping[str, Tensor] = field(default_factory=dict)
    weights: Float[Tensor, "*pixels"] | None = None


@runtime_checkable
class Loss(Protocol):
    """Knows the kind of batch that it is given."""

    buffers: tuple[str, ...]
    """What it looks at of a prediction besides colour, by name: "alpha", "depth", ...; a model that does not blend them
    is refused when a run is built."""

    @property
    def bytes_kept(self) -> int:
        """What lies in memory from step to step, of photographs as this loss wants them."""
        ...

    def compare(self, prediction: Rendering, batch: Any, model: Model) -> Compared:
        """Value and gradients, without a graph."""
        ...
