"""Parts and models under torch's autograd, for tests that compare gradients: each record's own way back is one node.

Gradients are known by full parameter name on the way; one by a name that nobody has is an error here.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.color.by_torch import OPACITY_FACTOR
from ringlight.color.contract import ColorModel
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, SHADER, Gradients, dense
from ringlight.core.rendering import Channels, Emission, Raster, Rendering
from ringlight.core.want import Want
from ringlight.models.contract import Model
from ringlight.models.way_back import ALPHA
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.shade.contract import Shader

WayBack = Callable[[list[Tensor | None]], dict[str, Any]]
"""From the gradients of outputs, None where there is none, to those of sources by name."""


class _Record(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, outputs: Sequence[Tensor], back: WayBack, names: Sequence[str], *_: Tensor):
        ctx.back, ctx.names = back, names
        ctx.set_materialize_grads(False)
        return tuple(output.detach() for output in outputs)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor | None):
        found = ctx.back(list(gradients))
        assert found.keys() <= set(ctx.names), f"gradients of what is not there: {found.keys() - set(ctx.names)}"
        return None, None, None, *(dense(found[name]) if name in found else None for name in ctx.names)


def recorded(outputs: Sequence[Tensor], back: WayBack, sources: dict[str, Tensor]) -> tuple[Tensor, ...]:
    """``outputs`` with a graph to ``sources``, which may be gone back once."""
    found: tuple[Tensor, ...] = _Record.apply(outputs, back, tuple(sources), *sources.values())
    return found


def channels(color: ColorModel, gaussians: Gaussians, camera: Camera, names: Sequence[str] | None = None) -> Channels:
    """What the colour model emits, all of it unless ``names`` are given, and "opacity_factor" [N 1] if it has one.

    Differentiable in the table's columns and in the model's parameters.
    """
    emission = color.emit(gaussians, camera, tuple(color.emits) if names is None else names, Want.GRADIENTS)
    sources = {COLUMNS + name: column for name, column in gaussians.columns().items()}
    sources |= {COLOR + name: parameter for name, parameter in color.named_parameters()}
    factors = [] if emission.opacity_factor is None else [emission.opacity_factor]

    def back(gradients: list[Tensor | None]) -> Gradients:
        of_channels, *of_factor = gradients
        into = Gradients()
        none = torch.zeros_like(emission.channels)
        emission.backward(none if of_channels is None else of_channels, *(of_factor or [None]), into)
        return into

    side_by_side, *factor = recorded([emission.channels, *factors], back, sources)
    found = dict(zip(emission.widths, side_by_side.split(list(emission.widths.values()), -1), strict=True))
    return found | ({OPACITY_FACTOR: factor[0][:, None]} if factor else {})


def drawn(
    rasterizer: Rasterizer,
    gaussians: Gaussians,
    channels: Tensor,
    camera: Camera,
    background: Tensor,
    options: RasterOptions = RasterOptions(),
    opacity_factor: Tensor | None = None,
) -> Raster:
    """One view, differentiable in the geometry, the channels [N C] and the opacity factor [N]."""
    emission = Emission({"channels": channels.shape[1]}, channels, opacity_factor)
    raster = rasterizer.draw(gaussians, emission, camera, background, options, Want.GRADIENTS)
    sources = {COLUMNS + name: getattr(gaussians, name) for name in GEOMETRY} | {"channels": channels}
    if opacity_factor is not None:
        sources[OPACITY_FACTOR] = opacity_factor

    def back(gradients: list[Tensor | None]) -> dict[str, Any]:
        of_image, of_alpha = gradients
        into = Gradients()
        none = torch.zeros_like(raster.image)
        of_channels, of_factor = raster.backward(none if of_image is None else of_image, of_alpha, into)
        assert (of_factor is None) == (opacity_factor is None)
        return into | {"channels": of_channels} | ({} if of_factor is None else {OPACITY_FACTOR: of_factor})

    image, alpha = recorded([raster.image, raster.alpha], back, sources)
    return replace(raster, image=image, alpha=alpha)


def image_of(shader: Shader, buffers: Channels) -> Tensor:
    """The buffers that the shader reads side by side, [H W C], planar in memory as a rasterizer leaves them."""
    return torch.cat([buffers[name].permute(2, 0, 1) for name in shader.needs]).permute(1, 2, 0)


def shaded(shader: Shader, buffers: Channels, camera: Camera, background: Tensor) -> Tensor:
    """Colours [H W 3] of buffers by name, in any order, with "alpha"; differentiable in all and the parameters."""
    image, alpha = image_of(shader, buffers), buffers[ALPHA]
    record = shader.shade(image, alpha, camera, background, Want.GRADIENTS)
    sources = {"image": image, ALPHA: alpha}
    sources |= {SHADER + name: parameter for name, parameter in shader.named_parameters()}

    def back(gradients: list[Tensor | None]) -> dict[str, Any]:
        into = Gradients()
        of_image, of_alpha = record.backward(gradients[0], into)
        return into | {"image": of_image} | ({} if of_alpha is None else {ALPHA: of_alpha})

    (color,) = recorded([record.color], back, sources)
    return color


def rendered(model: Model, camera: Camera, background: Tensor, buffers: Sequence[str] = ()) -> Rendering:
    """One image, differentiable in all parameters: colours, alpha and buffers may each have a gradient."""
    rendering = model.render(camera, background, Want.GRADIENTS, buffers)
    named = {name: buffer for name, buffer in rendering.buffers.items() if name != ALPHA}

    def back(gradients: list[Tensor | None]) -> Gradients:
        of_color, *of_buffers = gradients
        found = {name: g for name, g in zip((ALPHA, *named), of_buffers, strict=True) if g is not None}
        return rendering.backward(torch.zeros_like(rendering.color) if of_color is None else of_color, found)

    outputs = [rendering.color, rendering.alpha, *named.values()]
    color, alpha, *others = recorded(outputs, back, dict(model.named_parameters()))
    return replace(rendering, color=color, alpha=alpha, buffers=dict(zip(named, others, strict=True)) | {ALPHA: alpha})
