"""The socket: anything that changes a model's structure while it trains."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.models.splats import SplatModel


@runtime_checkable
class Strategy(Protocol):
    """Called after each optimizer step. Keeps whatever it counts in ``state``, so that a run can resume."""

    @property
    def most(self) -> int | None:
        """Rows to which it lets the model grow; None for one that adds none. Memory is planned by it."""
        ...

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, rendering: Rendering) -> None:
        """Look at the rendering of ``step`` and maybe change the model, through the optimizer's verbs."""
        ...

    def state(self) -> dict[str, Tensor]:
        """Tensors that a resumed run needs, by name; may be empty."""
        ...

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`."""
        ...
