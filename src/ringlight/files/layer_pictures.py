"""What a picture is made of, each part a picture of its own (RingLight-GS, figures 8 and 9)."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.files.false_color import (
    Range,
    depth_picture,
    depth_range,
    normal_picture,
    residual_picture,
    scalar_picture,
)
from ringlight.models.contract import Model

COLOR = "color"
"""The finished picture; every model has it."""

DEPTH_SAMPLES = 5
"""Views, spread over a film, that fix its depth scale: a scale of its own for each frame would make the film flicker.
"""

Picture = Float[Tensor, "H W 3"]


def layers_of(model: Model, camera: Camera) -> tuple[str, ...]:
    """Names of the layers that this model has, "color" first."""
    return (COLOR, *model.layers(camera))


def check_layers(model: Model, camera: Camera, wanted: Sequence[str]) -> None:
    """Raises RecipeError with the layers that there are, unless the model has all ``wanted`` ones."""
    known = layers_of(model, camera)
    missing = [name for name in wanted if name not in known]
    if missing:
        raise RecipeError(f"this model has no layer {missing[0]!r}; give --layers some of: {', '.join(known)}")


def common_depth_range(model: Model, cameras: Sequence[Camera]) -> Range:
    """Nearest and farthest depth over some views of a film, world units."""
    step = max(len(cameras) // DEPTH_SAMPLES, 1)
    ranges = [depth_range(found["depth"], found["alpha"]) for found in map(model.layers, cameras[::step])]
    return min(near for near, _ in ranges), max(far for _, far in ranges)


@torch.no_grad()
def layer_pictures(
    model: Model, camera: Camera, background: Float[Tensor, "3"], wanted: Sequence[str], near_far: Range
) -> dict[str, Picture]:
    """The ``wanted`` layers of one view as pictures in [0, 1].

    Pictures are on the CPU. Colours lie over ``background``; normals are world axes as red, green, blue; residuals are
    signed around middle gray; depth is light near and dark far, with ``near_far`` for its ends; modulation and alpha
    are gray values.
    """
    pictures = {}
    if COLOR in wanted:
        pictures[COLOR] = model.render(camera, background, Want.PICTURE).color.cpu().clamp(0, 1)
    parts = [name for name in wanted if name != COLOR]
    buffers = {name: values.cpu() for name, values in model.layers(camera).items()} if parts else {}
    for name in parts:
        pictures[name] = _PICTURES.get(name, _plain)(buffers, name, background, near_far)
    return pictures


def _plain(buffers: Channels, name: str, background: Float[Tensor, "3"], near_far: Range) -> Picture:
    """Any other layer: a colour over the background, or a gray value."""
    values = buffers[name]
    if values.shape[-1] == 1:
        return scalar_picture(values)
    return (values + (1 - buffers["alpha"]) * background).clamp(0, 1)


def _normal(buffers: Channels, name: str, background: Float[Tensor, "3"], near_far: Range) -> Picture:
    return torch.lerp(background.expand_as(buffers[name]), normal_picture(buffers[name]), buffers["alpha"].clamp(0, 1))


def _residual(buffers: Channels, name: str, background: Float[Tensor, "3"], near_far: Range) -> Picture:
    return residual_picture(buffers[name])


def _depth(buffers: Channels, name: str, background: Float[Tensor, "3"], near_far: Range) -> Picture:
    return depth_picture(buffers[name], buffers["alpha"], near_far)


_PICTURES: dict[str, Callable[[Channels, str, Float[Tensor, "3"], Range], Picture]] = {
    "normal": _normal,
    "residual": _residual,
    "depth": _depth,
}
