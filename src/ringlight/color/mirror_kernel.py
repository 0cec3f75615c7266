"""Autograd glue over the kernel that makes a Gaussian's channels for deferred shading, all of them in one tensor."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.kernel_limits import MIRROR_MAX_LATENTS


def kernel_takes(*columns: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU, and few enough latents, the last column."""
    kinds = {(column.dtype, column.device.type) for column in columns}
    return kinds == {(torch.float32, "cpu")} and columns[-1].shape[1] <= MIRROR_MAX_LATENTS


def mirror_channels(
    means: Float[Tensor, "N 3"],
    base: Float[Tensor, "N 3"],
    normals: Float[Tensor, "N 3"],
    latents: Float[Tensor, "N L"],
    camera: Camera,
    flip_below: float,
) -> Float[Tensor, "N C"]:
    """Base colour 3 from its logits, unit normal 3 towards the camera, latents L and depth 1, side by side."""
    columns = (column.contiguous() for column in (means, base, normals, latents))
    channels: Tensor = _MirrorChannels.apply(mirror_view(camera, flip_below), *columns)
    return channels


def mirror_view(camera: Camera, flip_below: float) -> _kernels.MirrorView:
    """What the kernel is told of a view."""
    return _kernels.MirrorView(camera=camera.native, flip_below=flip_below, smallest_length=SMALLEST_LENGTH)


class _MirrorChannels(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, view: _kernels.MirrorView, *columns: Tensor) -> Tensor:
        channels = columns[0].new_empty(len(columns[0]), 7 + columns[-1].shape[1])
        _kernels.mirror_channels(view, columns, channels)
        ctx.view = view
        ctx.save_for_backward(*columns)
        return channels

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        columns = ctx.saved_tensors
        gradients = [torch.empty_like(column) for column in columns]
        moved = _kernels.mirror_gradient(ctx.view, columns, upstream.contiguous(), gradients)
        return None, gradients[0] if moved else None, *gradients[1:]
