"""Steps of a tensor train's cores are scaled by what the other cores make of their indices.

See :mod:`ringlight.volume.tt_scaling`.
"""

from collections.abc import Callable, Mapping

from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.volume.tt_scaling import Scaling

RENEWED_EVERY = 10
"""Steps. Cores change little in so many, and to look at all of them takes half as long as a step."""

LEFT, RIGHT = "left.", "right."
"""Of a map's name in a checkpoint, before that of its parameter."""


class ScaledSteps:
    """From the second step on. Maps are made anew after every RENEWED_EVERY and after each refinement, which must come
    before it; ``made`` returns them by parameter name."""

    most: int | None = None

    def __init__(self, optimizer: Optimizer, made: Callable[[], Mapping[str, Scaling]]):
        self.optimizer, self.made = optimizer, made
        self._scalings: Mapping[str, Scaling] = {}

    def update(self, step: int, model: nn.Module, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step % RENEWED_EVERY and optimizer.scales:
            return
        self._take(self.made())

    def state(self) -> dict[str, Tensor]:
        """Both maps, [r r] and [s s], of each parameter that has them; none before the first step."""
        return _named(self._scalings)

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`. Raises ValueError for maps that these parameters
        cannot have."""
        if not state:
            self._take({})
            return
        scalings = self.made()
        expected = _named(scalings)
        if state.keys() != expected.keys():
            name = min(state.keys() ^ expected.keys())
            raise ValueError(f"steps of cores are scaled by other maps than it has: {name} is one too many or missing")
        for name, matrix in expected.items():
            found = state[name]
            if found.shape != matrix.shape or found.dtype != matrix.dtype or not found.isfinite().all():
                raise ValueError(f"{name}, by which steps are scaled, is no finite {matrix.dtype} of {matrix.shape}")
        copies = {name: matrix.to(expected[name], copy=True) for name, matrix in state.items()}
        self._take({name: Scaling(copies.get(LEFT + name), copies.get(RIGHT + name)) for name in scalings})

    def _take(self, scalings: Mapping[str, Scaling]) -> None:
        self._scalings = scalings
        self.optimizer.scale(scalings)


def _named(scalings: Mapping[str, Scaling]) -> dict[str, Tensor]:
    """As a checkpoint names them."""
    sides = ((prefix + name, m) for name, s in scalings.items() for prefix, m in ((LEFT, s.left), (RIGHT, s.right)))
    return {name: matrix for name, matrix in sides if matrix is not None}
