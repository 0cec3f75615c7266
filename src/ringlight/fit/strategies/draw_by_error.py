"""Rays are drawn by the errors of those before them: see :mod:`ringlight.data.ray_errors`."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.data.ray_errors import UNSEEN
from ringlight.data.rays import RayBatches
from ringlight.fit.optimizer import Optimizer


class DrawByError:
    """After each step the batches learn what was shown of their rays; a checkpoint keeps it."""

    most: int | None = None

    def __init__(self, batches: RayBatches):
        """Raises ValueError for batches that are drawn evenly."""
        if batches.errors is None:
            raise ValueError("these rays are all drawn evenly")
        self.batches, self.errors = batches, batches.errors

    def update(self, step: int, model: nn.Module, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        self.batches.learn(step, prediction.color)

    def state(self) -> dict[str, Tensor]:
        """Of all blocks of pixels."""
        return {"errors": self.errors.errors}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`. Raises ValueError for errors that the photographs
        cannot have."""
        errors, blocks = state["errors"], len(self.errors.errors)
        if errors.shape != (blocks,) or errors.dtype != torch.float32:
            raise ValueError(f"{blocks:,} blocks of pixels have errors of float32, not {errors.dtype} {errors.shape}")
        if not ((errors >= 0) & (errors <= UNSEEN)).all():
            raise ValueError("errors of blocks of pixels are numbers from 0 to 1")
        self.errors.errors = errors.clone()
