"""What a picture is made of, each part a picture of its own (RingLight-GS, figures 8 and 9)."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.files.false_color import depth_picture, depth_range, gray_picture, signed_picture
from ringlight.files.rigs import Look
from ringlight.models.contract import Model

COLOR = "color"
"""The finished picture; every model has it."""

ALPHA = "alpha"
"""How much of a pixel is covered; every model has it."""

DEPTH_SAMPLES = 5
"""Views, spread over a film, that fix its depth scale: a scale of its own for each frame would make the film flicker.
"""


def known_layers(model: Model, camera: Camera, wanted: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Of the ``wanted`` layers those that the model has, and those it lacks: which there are depends on how it is lit.

    Raises RecipeError with the layers that there are, where it has none of them.
    """
    known = (COLOR, *model.layers(camera))
    found = tuple(name for name in wanted if name in known)
    missing = tuple(name for name in wanted if name not in known)
    if not found:
        raise RecipeError(f"this model has no layer {missing[0]!r}; give --layers some of: {', '.join(known)}")
    return found, missing


def looking(model: Model, background: Float[Tensor, "3"], wanted: Sequence[str], want: Want = Want.PICTURE) -> Look:
    """What of a model is looked at: the ``wanted`` layers as numbers [H W c], on the CPU, with "alpha" beside all that
    is not colour. Colours lie over ``background``, all else over black; see ``Model.layers``."""
    parts = [name for name in wanted if name != COLOR]

    @torch.no_grad()
    def look(camera: Camera) -> Channels:
        found: Channels = {}
        if COLOR in wanted:
            found[COLOR] = model.render(camera, background, want).color.cpu()
        shown = model.layers(camera) if parts else {}
        return found | {name: shown[name].cpu() for name in dict.fromkeys([*parts, ALPHA]) if parts}

    return look


def common_depth_range(look: Look, cameras: Sequence[Camera]) -> tuple[float, float]:
    """Nearest and farthest depth over some views of a film, world units; ``look`` shows depth and alpha."""
    step = max(len(cameras) // DEPTH_SAMPLES, 1)
    ranges = [depth_range(found["depth"], found[ALPHA]) for found in map(look, cameras[::step])]
    return min(near for near, _ in ranges), max(far for _, far in ranges)


def layer_pictures(
    found: Channels, background: Float[Tensor, "3"], wanted: Sequence[str], near_far: tuple[float, float]
) -> dict[str, Float[Tensor, "H W 3"]]:
    """The ``wanted`` layers of one view, of what was ``found`` by :func:`looking`, as pictures in [0, 1].

    Colours lie over ``background``; normals are world axes as red, green, blue; residuals are signed around middle
    gray; depth is light near and dark far, with ``near_far`` for its ends; modulation and alpha are gray values.
    """
    return {name: _picture(name, found, background, near_far) for name in wanted}


def _picture(
    name: str, buffers: Channels, background: Float[Tensor, "3"], near_far: tuple[float, float]
) -> Float[Tensor, "H W 3"]:
    if name == COLOR:
        return buffers[COLOR].clamp(0, 1)
    values, alpha = buffers[name], buffers[ALPHA]
    if name == "depth":
        return depth_picture(values, alpha, near_far)
    if name == "residual":
        return signed_picture(values)
    if name == "normal":
        return torch.lerp(background.expand_as(values), signed_picture(values), alpha.clamp(0, 1))
    if values.shape[-1] == 1:
        return gray_picture(values)
    return (values + (1 - alpha) * background).clamp(0, 1)
