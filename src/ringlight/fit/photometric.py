"""Settings of the photometric loss; apart from its code, so that the command line can show them without torch."""

import math
from dataclasses import dataclass
from typing import Literal

from ringlight.errors import RecipeError


@dataclass(frozen=True)
class PhotometricLoss:
    """``scale * ((1 - ssim_weight) * pixel + ssim_weight * (1 - SSIM))``: RingLight equation 9, 3DGS equation 7."""

    pixel: Literal["l1", "l2"] = "l1"
    """Pixel term: l1 is the mean absolute error (3DGS), l2 the mean squared error (RingLight)."""
    ssim_weight: float = 0.2
    """Share of 1 - SSIM, in [0, 1]: lambda in 3DGS, beta in RingLight."""
    scale: float = 1.0
    """Factor on the whole loss: gamma in RingLight."""

    def __post_init__(self) -> None:
        if not 0 <= self.ssim_weight <= 1:
            raise RecipeError(f"loss.ssim_weight is {self.ssim_weight:g}; give a share from 0 to 1")
        if not 0 < self.scale < math.inf:
            raise RecipeError(f"loss.scale is {self.scale:g}; give a number above zero")
