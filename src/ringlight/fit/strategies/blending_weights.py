"""What each Gaussian covers of the photographs' pictures."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.models.splats import SplatModel


class Coverage(NamedTuple):
    """Of each row in the pictures of some cameras, in pixels."""

    weights: Float[Tensor, "N"]
    """Its alpha times transmittance, summed over all pixels."""
    footprints: Float[Tensor, "N"]
    """Its opacity towards the camera times half-width and half-height of what it may touch, summed over the pictures
    that it touches: more than it would cover alone, by a factor that hardly differs between rows."""


def blending_weights(model: SplatModel, cameras: Sequence[Camera]) -> Float[Tensor, "N"]:
    """See :class:`Coverage`."""
    return coverage(model, cameras).weights


def coverage(model: SplatModel, cameras: Sequence[Camera]) -> Coverage:
    """Of all rows in the pictures of all ``cameras``.

    A row's weight is what the picture's sum gains by its colour: a gradient, which any rasterizer gives.
    """
    table = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
    wanted, weights = model.color.wanted(table).to(table.means), torch.zeros_like(table.opacity_logits)
    footprints = torch.zeros_like(weights)
    black, vary = torch.zeros(3), opacities_vary(model, cameras)
    for camera in cameras:
        towards = model.color.emit(table, camera, ("rgb",), Want.EXACT).opacity_factor if vary else None
        factor = wanted if towards is None else wanted * towards.detach()
        emission = Emission({"rgb": 3}, torch.zeros_like(table.means), factor)
        raster = model.rasterize.draw(table, emission, camera, black, model.options, Want.GRADIENTS)
        first = torch.zeros_like(raster.image)
        first[..., 0] = 1
        grad_channels, _ = raster.backward(first, None, Gradients())
        weights += grad_channels[:, 0]
        footprints += factor * table.opacities * raster.footprint.radii.detach().prod(1)
    return Coverage(weights, footprints)


@torch.no_grad()
def opacities_vary(model: SplatModel, cameras: Sequence[Camera]) -> bool:
    """Whether opacities depend on the camera. One is asked: a neural field's answer costs as much as its colours."""
    asked = cameras[:1]
    return any(
        model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT).opacity_factor is not None for camera in asked
    )
