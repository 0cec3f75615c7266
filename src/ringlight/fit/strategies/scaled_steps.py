"""Steps of a tensor train's cores are scaled by what the other cores make of their indices, and perhaps go along
near-orthogonal matrices.

See :mod:`ringlight.volume.tt_scaling` and :mod:`ringlight.volume.tt_directions`.
"""

from collections.abc import Callable, Mapping
from functools import partial

import torch
from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.core.shared_pieces import each_of
from ringlight.fit.optimizer import Directed, Optimizer
from ringlight.volume.tt_directions import MOMENTUM, InverseRoots, inverse_roots
from ringlight.volume.tt_scaling import Scaling

RENEWED_EVERY = 10
"""Steps. Cores change little in so many, and to look at all of them takes a third as long as a step. Of means two
fifths are new then, and yet held-out views were the same (docs/experiments/putt.md)."""


class ScaledSteps:
    """Those after step ``begin``, but never the first. Maps are made anew after every RENEWED_EVERY and after each
    refinement, which must come before it; ``made`` returns new ones by parameter name. ``orthogonal`` steps go along
    near-orthogonal matrices in place of Adam's; what means are multiplied by for them is made with the maps. Those made
    right after a refinement are of no means yet: steps go along means themselves until the next are made."""

    most: int | None = None

    def __init__(
        self,
        optimizer: Optimizer,
        made: Callable[[], Mapping[str, Scaling]],
        begin: int = 0,
        orthogonal: bool = False,
    ):
        self.optimizer, self.made, self.begin, self.orthogonal = optimizer, made, begin, orthogonal
        self._scalings: Mapping[str, Scaling] = {}
        self._roots: Mapping[str, InverseRoots] = {}

    def update(self, step: int, model: nn.Module, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step < self.begin or (step % RENEWED_EVERY and optimizer.scales):
            return
        self._make()
        self._hand_over()

    def state(self) -> dict[str, Tensor]:
        """Numbers of all maps, one after another, and then of all roots; none before the first step."""
        matrices = self._matrices()
        return {"maps": torch.cat([matrix.flatten() for matrix in matrices]) if matrices else torch.zeros(0)}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`. Raises ValueError for maps that the parameters,
        which are restored already, cannot have."""
        numbers = state["maps"]
        self._scalings, self._roots = {}, {}
        if numbers.numel():
            self._make()
        matrices = self._matrices()
        if numbers.shape == (_count(_maps(self._scalings)),):
            matrices = _maps(self._scalings)  # of a commit that made all else anew at each step
        if numbers.shape != (_count(matrices),) or not numbers.is_floating_point() or not numbers.isfinite().all():
            count = _count(matrices)
            raise ValueError(f"steps are scaled by {count:,} finite numbers, not by {numbers.dtype} {numbers.shape}")
        parts = numbers.split([matrix.numel() for matrix in matrices]) if matrices else ()
        for matrix, part in zip(matrices, parts, strict=True):
            matrix.copy_(part.view_as(matrix))
        self._hand_over()

    def _make(self) -> None:
        """By cores, and means of their gradients, as they are now."""
        self._scalings = self.made()
        if self.orthogonal:
            means = self.optimizer.means(self._scalings)
            device = next(iter(means.values())).device
            roots = each_of([partial(inverse_roots, mean) for mean in means.values()], device)
            self._roots = dict(zip(means, roots, strict=True))

    def _hand_over(self) -> None:
        self.optimizer.scale(self._scalings, Directed(self._roots, MOMENTUM) if self.orthogonal else None)

    def _matrices(self) -> list[Tensor]:
        """All, in the order in which a checkpoint has them."""
        roots = [matrix for root in self._roots.values() for matrix in (root.of_left, root.of_right)]
        return [*_maps(self._scalings), *roots]


def _maps(scalings: Mapping[str, Scaling]) -> list[Tensor]:
    both = [matrix for scaling in scalings.values() for matrix in (scaling.left, scaling.right)]
    return [matrix for matrix in both if matrix is not None]


def _count(matrices: list[Tensor]) -> int:
    return sum(matrix.numel() for matrix in matrices)
