"""The photographs as the loss wants them: float, planar, blurred once, kept while they fit a budget of memory."""

from collections import OrderedDict

import torch

from ringlight.core.memory import machine_memory
from ringlight.data.batches import ImageBatch
from ringlight.fit.losses import Target

BUDGET_BYTES = 1 << 30
"""Photographs stay 8 bit; their float form and blurs (36 bytes a pixel) are kept up to this, the oldest go first."""

SMALLEST_SHARE = 16
"""Of a machine's memory, one part in as many is the budget where that is less."""

BYTES_PER_PIXEL = 36


class Targets:
    """A least-recently-used cache. It changes speed and memory, never a number."""

    def __init__(self, budget_bytes: int | None = None, device: torch.device | None = None):
        self.device = device or torch.device("cpu")
        default = min(BUDGET_BYTES, machine_memory() // SMALLEST_SHARE)
        self.budget_bytes, self._bytes = default if budget_bytes is None else budget_bytes, 0
        self._kept: OrderedDict[tuple[int, int, int], Target] = OrderedDict()

    def of(self, batch: ImageBatch) -> Target:
        """The batch's photograph over its background; a background that changes each step is never kept."""
        key = (batch.index, batch.camera.width, batch.camera.height)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        target = Target(batch.view.image(batch.background).to(self.device))
        if batch.has_fixed_background:
            self._keep(key, target, batch.camera.width * batch.camera.height * BYTES_PER_PIXEL)
        return target

    @property
    def bytes_kept(self) -> int:
        """Of the photographs' float forms, with the largest that their blurs get."""
        return self._bytes

    def _keep(self, key: tuple[int, int, int], target: Target, size: int) -> None:
        if size > self.budget_bytes:
            return
        self._kept[key] = target
        self._bytes += size
        while self._bytes > self.budget_bytes:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= dropped.image[0].numel() * BYTES_PER_PIXEL
