"""The loss of whole photographs: decoded once, float, planar, blurred once, compared by the kernels."""

from collections import OrderedDict

import torch

from ringlight.core.memory import machine_memory
from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch
from ringlight.fit.losses.contract import Compared
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.models.contract import Model

BUDGET_BYTES = 1 << 30
"""Photographs stay 8 bit; their float form and blurs (36 bytes a pixel) are kept up to this, the oldest go first."""

SMALLEST_SHARE = 16
"""Of a machine's memory, one part in as many is the budget where that is less."""

BYTES_PER_PIXEL = 36


class PhotographLoss:
    """Pixel term and structural similarity of photographs, whose float forms are kept while they fit a budget.

    What is kept, the most recently used, changes speed and memory, never a number.
    """

    buffers: tuple[str, ...] = ()

    def __init__(self, settings: PhotometricLoss, device: torch.device | None = None, budget_bytes: int | None = None):
        self.settings, self.device = settings, device or torch.device("cpu")
        default = min(BUDGET_BYTES, machine_memory() // SMALLEST_SHARE)
        self.budget_bytes, self._bytes = default if budget_bytes is None else budget_bytes, 0
        self._kept: OrderedDict[tuple[int, int, int, float, float], Target] = OrderedDict()

    def compare(self, prediction: Rendering, batch: ImageBatch, model: Model) -> Compared:
        """See :class:`ringlight.fit.losses.contract.Loss`."""
        target = self.target(batch)
        value, gradient = photometric_gradient(prediction.color, target, self.settings)
        return Compared(value, gradient, target.image.permute(1, 2, 0))

    def target(self, batch: ImageBatch) -> Target:
        """The batch's photograph over its background; a background that changes each step is never kept."""
        camera = batch.camera
        key = (batch.index, camera.width, camera.height, *camera.center)  # crops of one size differ in their centres
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        target = Target(batch.view.image(batch.background).to(self.device))
        if batch.has_fixed_background:
            self._keep(key, target, camera.width * camera.height * BYTES_PER_PIXEL)
        return target

    @property
    def bytes_kept(self) -> int:
        """Of the photographs' float forms, with the largest that their blurs get."""
        return self._bytes

    def _keep(self, key: tuple[int, int, int, float, float], target: Target, size: int) -> None:
        if size > self.budget_bytes:
            return
        self._kept[key] = target
        self._bytes += size
        while self._bytes > self.budget_bytes:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= dropped.image[0].numel() * BYTES_PER_PIXEL
