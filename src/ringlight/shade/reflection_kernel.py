"""Autograd glue over the fused reflection shader: planes and parameters in, colours out, nothing kept in between."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.kernel_limits import (
    REFLECTION_MAX_FEATURES,
    REFLECTION_MAX_HIDDEN,
    REFLECTION_MAX_LATENTS,
    REFLECTION_MAX_LEVELS,
    REFLECTION_MAX_SIDE,
    REFLECTION_QUAD,
)
from ringlight.core.rendering import Channels
from ringlight.fields.parallax import SMALLEST_HALF_CHORD_SQUARED
from ringlight.shade.covered import FAINTEST_SHADED, SHORTEST_NORMAL
from ringlight.shade.reflection_settings import ReflectionSettings


def kernel_takes(settings: ReflectionSettings, buffers: Mapping[Any, Tensor]) -> bool:
    """Whether the kernel can do it: float32 on the CPU, and sizes that it takes."""
    kinds = {(values.dtype, values.device.type) for values in buffers.values()}
    return sizes_fit(settings) and kinds == {(torch.float32, "cpu")}


def sizes_fit(settings: ReflectionSettings) -> bool:
    """Whether the kernel takes them: no ring, features in fours, and none beyond its limits."""
    fits = (
        settings.ring == "none"
        and settings.axis_nodes <= REFLECTION_MAX_SIDE
        and settings.hidden <= REFLECTION_MAX_HIDDEN
        and settings.latents <= REFLECTION_MAX_LATENTS
        and max(settings.levels) <= REFLECTION_MAX_SIDE
    )
    fits = fits and settings.features <= REFLECTION_MAX_FEATURES and settings.features % REFLECTION_QUAD == 0
    return fits and len(settings.levels) <= REFLECTION_MAX_LEVELS


@dataclass(frozen=True)
class ReflectionJob:
    """One view to shade, without what has a gradient; ``depth`` says whether blended depth is read."""

    shape: _kernels.ReflectionShape
    view: _kernels.ReflectionView
    depth: bool
    depth_gradient: bool
    gradient_share: float


def reflection_job(
    settings: ReflectionSettings, camera: Camera, background: Float[Tensor, "3"], box: Float[Tensor, "2 3"]
) -> ReflectionJob:
    """What the kernel is told; the frame is that of ``ReflectionShader``, the box's longest side is [-1, 1]."""
    depth = settings.parallax or settings.axis_nodes > 0
    depth_gradient = settings.depth_gradient and depth
    shape = _kernels.ReflectionShape(
        hidden=settings.hidden,
        layers=settings.hidden_layers + 1,
        latents=settings.latents,
        shells=settings.shells,
        features=settings.features,
        sides=settings.levels,
        parallax=settings.parallax,
        direction=settings.raw_direction,
        depth_gradient=depth_gradient,
        axis_nodes=settings.axis_nodes,
    )
    box, background = (tensor.detach().float().contiguous() for tensor in (box, background))
    view = _kernels.ReflectionView(
        camera=camera.native,
        box=box,
        background=background,
        faintest=FAINTEST_SHADED,
        shortest_normal=SHORTEST_NORMAL,
        smallest_chord=SMALLEST_HALF_CHORD_SQUARED,
    )
    return ReflectionJob(shape, view, depth, depth_gradient, settings.gradient_share)


def reflect_by_kernel(job: ReflectionJob, buffers: Channels, parameters: list[Tensor]) -> Float[Tensor, "H W 3"]:
    """``parameters``: the maps by shell and level, spheres and axes if there are any, each layer's weights and bias."""
    if not torch.is_grad_enabled():
        return shaded(job, planes_of(job, buffers), parameters)
    rgb, alpha = buffers["rgb"], buffers["alpha"]
    nothing = rgb.new_empty(*rgb.shape[:2], 0)
    depth = buffers["depth"] if job.depth else None
    color: Tensor = _Reflect.apply(
        job, rgb, buffers["normal"], buffers.get("latents", nothing), alpha, depth, *parameters
    )
    return color


def planes_of(job: ReflectionJob, buffers: Channels) -> list[Float[Tensor, "_ H W"]]:
    """The blended planes in the kernel's order: rgb, normal, latents, alpha and, where it is read, depth."""
    rgb = buffers["rgb"]
    latents = buffers.get("latents", rgb.new_empty(*rgb.shape[:2], 0))
    planes = [rgb, buffers["normal"], latents, buffers["alpha"], *([buffers["depth"]] if job.depth else [])]
    return [_planar(values) for values in planes]


def shaded(job: ReflectionJob, planes: Sequence[Tensor], parameters: Sequence[Tensor]) -> Float[Tensor, "H W 3"]:
    """The kernel's picture, planar in memory; ``planes`` as :func:`planes_of` has them."""
    color = torch.empty_like(planes[0])
    _kernels.reflection_forward(job.shape, parameters, job.view, planes, color)
    return color.permute(1, 2, 0)


def shading_of(job: ReflectionJob, parameters: Sequence[Tensor], exact: bool = False) -> _kernels.PictureShader:
    """The same picture from inside the rasterizer, where the blended planes need not be kept: rgb, normal, latents and
    depth, side by side. Unless ``exact``, wide layers multiply bytes where the processor can."""
    return _kernels.ReflectionPicture(job.shape, parameters, job.view, exact)


def _planar(values: Float[Tensor, "H W c"]) -> Float[Tensor, "c H W"]:
    return values.permute(2, 0, 1).contiguous()


ALPHA = 3
"""Its place among the kernel's planes, see :func:`planes_of`."""


class _Reflect(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        job: ReflectionJob,
        rgb: Tensor,
        normal: Tensor,
        latents: Tensor,
        alpha: Tensor,
        depth: Tensor | None,
        *parameters: Tensor,
    ) -> Tensor:
        buffers = [rgb, normal, latents, alpha] if depth is None else [rgb, normal, latents, alpha, depth]
        planes = [_planar(values) for values in buffers]
        ctx.job, ctx.count = job, len(planes)
        ctx.save_for_backward(*planes, *parameters)
        return shaded(job, planes, parameters)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, by_color: Tensor) -> tuple[Tensor | None, ...]:
        job, planes, parameters = ctx.job, ctx.saved_tensors[: ctx.count], ctx.saved_tensors[ctx.count :]
        gradients = [torch.empty_like(parameter) for parameter in parameters]
        block, by_alpha = plane_gradients(job, planes, parameters, by_color, gradients)
        blended = [plane for index, plane in enumerate(planes) if index != ALPHA]
        by_rgb, by_normal, by_latents, *by_depth = block.split([len(plane) for plane in blended])
        by_buffers = [plane.permute(1, 2, 0) for plane in [by_rgb, by_normal, by_latents, by_alpha, *by_depth]]
        return None, *by_buffers, *([] if by_depth else [None]), *gradients


def plane_gradients(
    job: ReflectionJob,
    planes: Sequence[Tensor],
    parameters: Sequence[Tensor],
    by_color: Float[Tensor, "H W 3"],
    gradients: Sequence[Tensor],
) -> tuple[Float[Tensor, "C H W"], Float[Tensor, "1 H W"]]:
    """Gradients of the blended planes and of alpha; fills in those of the parameters.

    The planes' are one block, in the order in which colour models blend: whoever parted the image can hand it on as it
    is.
    """
    blended = [plane for index, plane in enumerate(planes) if index != ALPHA]
    block = by_color.new_empty(sum(map(len, blended)), *blended[0].shape[1:])
    by_rgb, by_normal, by_latents, *by_depth = block.split([len(plane) for plane in blended])
    by_alpha = torch.empty_like(planes[ALPHA])
    by_planes = [by_rgb, by_normal, by_latents, by_alpha]
    _kernels.reflection_backward(
        job.shape, parameters, job.view, planes, _planar(by_color), job.gradient_share, gradients,
        [*by_planes, *by_depth] if job.depth_gradient else by_planes,
    )  # fmt: skip
    if by_depth and not job.depth_gradient:
        by_depth[0].zero_()
    return block, by_alpha
