"""Global significance: what a Gaussian covers in all training pictures, times a power of its volume.

LightGaussian (Fan et al. 2023), section 3.2, equation 4.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.fit.strategies.blending_weights import blending_weights
from ringlight.models.splats import SplatModel
from ringlight.rasterize.convention import MIN_ALPHA

LARGE = 0.9
"""Volumes count up to that which this share of all Gaussians stays below, so that a few huge ones do not rule."""

FAINTEST = 1e-3
"""Of how far an opacity is above the faintest that is drawn, as a share of that: nearer, the limit is reached."""


@torch.no_grad()
def global_significance(model: SplatModel, cameras: Sequence[Camera], volume_power: float) -> Float[Tensor, "N"]:
    """The sum, over all pixels that a row's footprint hits, of opacity times transmittance, times (V / V90)^power.

    V is the product of the standard deviations, V90 as :data:`LARGE` says, and V / V90 at most 1. The sum over pixels
    follows from that of alpha times transmittance, a gradient which any rasterizer gives: a footprint of opacity o ends
    where alpha is 1/255, so that its area is to the sum of the falloff as ln(255 o) to 1 - 1/(255 o). That is exact
    where the transmittance is even over a footprint of many pixels; elsewhere its middle counts more than its rim.
    """
    table = model.gaussians
    hits = blending_weights(model, cameras) * area_over_falloff(table.opacities)
    return hits * volume_factor(table, volume_power)


def area_over_falloff(opacities: Float[Tensor, "N"]) -> Float[Tensor, "N"]:
    """The area of a footprint over the integral of its falloff, at least 1."""
    above = (opacities / MIN_ALPHA).clamp_min(1 + FAINTEST)
    return above.log() / (1 - 1 / above)


def volume_factor(table: Gaussians, power: float) -> Float[Tensor, "N"]:
    """(V / V90)^power, in (0, 1]."""
    volumes = table.log_scales.sum(-1)
    large = volumes.sort().values[int(LARGE * (len(volumes) - 1))]
    return (power * (volumes - large).clamp_max(0)).exp()
