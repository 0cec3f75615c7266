"""What a prediction is compared with: the loss of a step and the gradient with which its way back begins."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch
from ringlight.fit.losses import photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.targets import Targets


@dataclass(frozen=True)
class Compared:
    """``truth`` is what the colours should have been, in [0, 1]."""

    value: Float[Tensor, ""]
    grad_color: Float[Tensor, "*pixels 3"]
    truth: Float[Tensor, "*pixels 3"]


@runtime_checkable
class Loss(Protocol):
    """Knows the kind of batch that it is given."""

    bytes_kept: int
    """What lies in memory from step to step, of photographs as this loss wants them."""

    def compare(self, prediction: Rendering, batch: Any) -> Compared:
        """Value and gradient, without a graph."""
        ...


class PhotographLoss:
    """Pixel term and structural similarity of whole photographs, which are decoded and blurred once where they fit."""

    def __init__(self, settings: PhotometricLoss, device: torch.device, targets: Targets | None = None):
        self.settings, self.targets = settings, targets or Targets(device=device)

    @property
    def bytes_kept(self) -> int:
        """Of the photographs' float forms and blurs."""
        return self.targets.bytes_kept

    def compare(self, prediction: Rendering, batch: ImageBatch) -> Compared:
        """See :class:`Loss`."""
        target = self.targets.of(batch)
        value, gradient = photometric_gradient(prediction.color, target, self.settings)
        return Compared(value, gradient, target.image.permute(1, 2, 0))
