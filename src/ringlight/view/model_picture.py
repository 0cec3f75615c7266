"""One picture of a model: a layer, or its colour with the light faded."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.want import Want
from ringlight.files.false_color import depth_range
from ringlight.files.layer_pictures import COLOR, layer_pictures, looking
from ringlight.models.contract import Model

BASE, ALPHA, DEPTH = "base", "alpha", "depth"

BRIGHTEST = 2.0
"""Largest factor on the light."""

TRIED_SIDE = 16
"""Pixels of the picture by which a model's layers are found."""


@torch.no_grad()
def layers_of(model: Model, camera: Camera) -> tuple[str, ...]:
    """The layers that it has, the finished picture first."""
    return (COLOR, *model.layers(camera.resized(TRIED_SIDE, TRIED_SIDE)))


@torch.no_grad()
def model_picture(
    model: Model, camera: Camera, background: Float[Tensor, "3"], layer: str = COLOR, light: float = 1.0
) -> Float[Tensor, "H W 3"]:
    """What the camera sees of ``layer`` over ``background``, in [0, 1], on the CPU. No bit of the model changes.

    ``light`` in [0, BRIGHTEST] is a factor on what depends on the view, of the finished picture alone: the base colours
    plus so much of what the method adds to them. At 1 it is the picture as it is rendered, at 0 the base colours alone.
    A layer that the model lacks gives the finished picture, and so does a ``light`` where it has no base colours.
    """
    if layer == COLOR and light != 1.0:
        return _faded(model, camera, background, light)
    if layer not in (COLOR, DEPTH) and layer not in layers_of(model, camera):
        layer = COLOR
    found = looking(model, background, (layer,))(camera)
    near_far = depth_range(found[DEPTH], found[ALPHA]) if layer == DEPTH else (0.0, 1.0)
    return layer_pictures(found, background, (layer,), near_far)[layer]


def _faded(model: Model, camera: Camera, background: Tensor, light: float) -> Float[Tensor, "H W 3"]:
    """Blending is linear: the sum over Gaussians of base + light * (shown - base) is that of the two pictures, also
    where a shader adds light to blended pixels. Exact pictures: their difference is multiplied."""
    found = model.layers(camera)
    if BASE not in found:
        return model.render(camera, background, Want.PICTURE).color.cpu().clamp(0, 1)
    base = (found[BASE] + (1 - found[ALPHA]) * background.to(found[BASE])).cpu()
    if light == 0.0:
        return base.clamp(0, 1)
    shown = model.render(camera, background, Want.EXACT).color.cpu()
    return (base + light * (shown - base)).clamp(0, 1)
