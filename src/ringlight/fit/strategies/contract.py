"""The socket: anything that changes a model's structure while it trains."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer


@runtime_checkable
class Strategy(Protocol):
    """Called after each optimizer step. Keeps whatever it counts in ``state``, so that a run can resume."""

    @property
    def most(self) -> int | None:
        """Rows to which it lets the model grow; None for one that adds none. Memory is planned by it."""
        ...

    def update(self, step: int, model: Any, optimizer: Optimizer, prediction: Rendering) -> None:
        """Look at the prediction of ``step`` and maybe change the model, through the optimizer's verbs.

        The model is of the kind that the recipe builds.
        """
        ...

    def state(self) -> dict[str, Tensor]:
        """Tensors that a resumed run needs, by name; may be empty."""
        ...

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`."""
        ...


@runtime_checkable
class DensityControl(Strategy, Protocol):
    """A strategy that decides where Gaussians are wanted."""

    def resets(self, step: int) -> bool:
        """Whether opacities are lowered after this step, so that the loss rises."""
        ...


@runtime_checkable
class AtTheEnd(Strategy, Protocol):
    """A strategy whose work is due at the end of a run, wherever that comes to be."""

    def extend(self, added: int) -> None:
        """The run has so many steps more."""
        ...
