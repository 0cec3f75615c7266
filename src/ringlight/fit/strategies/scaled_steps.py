"""Steps of a tensor train's cores are scaled by what the other cores make of their indices.

See :mod:`ringlight.volume.tt_scaling`.
"""

from collections.abc import Mapping

from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.volume.model import VolumeModel
from ringlight.volume.tensor_train_field import TensorTrainField
from ringlight.volume.tt_scaling import Scaling

RENEWED_EVERY = 10
"""Steps. Cores change little in so many, and to look at all of them takes half as long as a step."""


LEFT, RIGHT = "left.", "right."


class ScaledSteps:
    """From the first step on, and anew after every RENEWED_EVERY and after each refinement, which must come before it.

    ``share`` is that of :func:`ringlight.volume.tt_scaling.scalings`.
    """

    most: int | None = None

    def __init__(self, optimizer: Optimizer, share: float):
        self.optimizer, self.share = optimizer, share
        self._scalings: dict[str, Scaling] = {}

    def update(self, step: int, model: VolumeModel, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step % RENEWED_EVERY and optimizer.scales:
            return
        assert isinstance(model.field, TensorTrainField)
        self._take({f"field.{name}": scaling for name, scaling in model.field.scalings(self.share).items()})

    def state(self) -> dict[str, Tensor]:
        """Both maps of each parameter that has them."""
        maps = {LEFT: "left", RIGHT: "right"}
        found = {p + name: getattr(s, side) for name, s in self._scalings.items() for p, side in maps.items()}
        return {name: matrix for name, matrix in found.items() if matrix is not None}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`. Raises ValueError for maps of other sizes than the
        parameters have."""
        scalings: dict[str, Scaling] = {}
        for name in dict.fromkeys(name.removeprefix(LEFT).removeprefix(RIGHT) for name in state):
            parameter = self.optimizer.model.get_parameter(name)
            left, right = state.get(LEFT + name), state.get(RIGHT + name)
            for matrix, size in ((left, parameter.shape[0]), (right, parameter.shape[-1])):
                if matrix is not None and matrix.shape != (size, size):
                    raise ValueError(f"steps of {name} are scaled by {tuple(matrix.shape)}, not by {size} squared")
            scalings[name] = Scaling(*(None if m is None else m.to(parameter, copy=True) for m in (left, right)))
        self._take(scalings)

    def _take(self, scalings: dict[str, Scaling]) -> None:
        self._scalings = scalings
        self.optimizer.scale(scalings)
