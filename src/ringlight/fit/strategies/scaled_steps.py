"""Steps of a tensor train's cores are scaled by what the other cores make of their indices, and perhaps go along
near-orthogonal matrices.

See :mod:`ringlight.volume.tt_scaling` and :mod:`ringlight.volume.tt_directions`.
"""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Directed, Optimizer
from ringlight.volume.tt_scaling import Scaling

RENEWED_EVERY = 10
"""Steps. Cores change little in so many, and to look at all of them takes a third as long as a step."""


class ScaledSteps:
    """Those after step ``begin``, but never the first. Maps are made anew after every RENEWED_EVERY and after each
    refinement, which must come before it; ``made`` returns them by parameter name. What is ``directed`` steps
    in place of Adam."""

    most: int | None = None

    def __init__(
        self,
        optimizer: Optimizer,
        made: Callable[[], Mapping[str, Scaling]],
        begin: int = 0,
        directed: Directed | None = None,
    ):
        self.optimizer, self.made, self.begin, self.directed = optimizer, made, begin, directed
        self._scalings: Mapping[str, Scaling] = {}

    def update(self, step: int, model: nn.Module, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step < self.begin or (step % RENEWED_EVERY and optimizer.scales):
            return
        self._take(self.made())

    def state(self) -> dict[str, Tensor]:
        """Numbers of all maps, one after another; none before the first step."""
        matrices = _matrices(self._scalings)
        return {"maps": torch.cat([m.flatten() for m in matrices.values()]) if matrices else torch.zeros(0)}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`. Raises ValueError for maps that the parameters,
        which are restored already, cannot have."""
        numbers = state["maps"]
        scalings = self.made() if numbers.numel() else {}
        matrices = _matrices(scalings)
        count = sum(matrix.numel() for matrix in matrices.values())
        if numbers.shape != (count,) or not numbers.is_floating_point() or not numbers.isfinite().all():
            raise ValueError(f"steps are scaled by {count:,} finite numbers, not by {numbers.dtype} {numbers.shape}")
        parts = numbers.split([matrix.numel() for matrix in matrices.values()]) if matrices else ()
        kept = {
            key: part.view_as(matrix).to(matrix, copy=True)
            for (key, matrix), part in zip(matrices.items(), parts, strict=True)
        }
        self._take({name: Scaling(kept.get((name, 0)), kept.get((name, 1))) for name in scalings})

    def _take(self, scalings: Mapping[str, Scaling]) -> None:
        self._scalings = scalings
        self.optimizer.scale(scalings, self.directed)


def _matrices(scalings: Mapping[str, Scaling]) -> dict[tuple[str, int], Tensor]:
    """By parameter name, and 0 for the map of the left index, 1 for the right one's."""
    both = (((name, side), m) for name, s in scalings.items() for side, m in enumerate((s.left, s.right)))
    return {key: matrix for key, matrix in both if matrix is not None}
