"""The environment's kernel: planes and logits in, colours out; the cubemap's colours are kept for the way back."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.fields.cubemap import border
from ringlight.shade.covered import FAINTEST_SHADED, SHORTEST_NORMAL

TEXEL = 4
"""Floats that the kernel keeps of a texel's colour; the last is unused."""


def kernel_takes(*tensors: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU."""
    return {(tensor.dtype, tensor.device.type) for tensor in tensors} == {(torch.float32, "cpu")}


@dataclass(frozen=True)
class EnvironmentJob:
    """One view to shade: blended planes, and the cubemap's logits and colours, these with the texels around a face."""

    view: _kernels.EnvironmentView
    logits: Float[Tensor, "6 S S 3"]
    colors: Float[Tensor, "6 S+2 S+2 4"]
    image: Float[Tensor, "7 H W"]
    alpha: Float[Tensor, "1 H W"]


def environment_job(
    logits: Float[Tensor, "6 S S 3"], image: Float[Tensor, "H W 7"], alpha: Float[Tensor, "H W 1"], camera: Camera
) -> EnvironmentJob:
    """``image`` holds rgb, normal and strength side by side."""
    logits, side = logits.detach().contiguous(), logits.shape[1]
    colors = logits.new_empty(len(logits), side + 2, side + 2, TEXEL)
    _kernels.cubemap_colors(logits, *border(side), colors)
    view = _kernels.EnvironmentView(camera=camera.native, faintest=FAINTEST_SHADED, shortest_normal=SHORTEST_NORMAL)
    planes, opacity = (picture.permute(2, 0, 1).contiguous() for picture in (image, alpha))
    return EnvironmentJob(view, logits, colors, planes, opacity)


def environment_color(job: EnvironmentJob) -> Float[Tensor, "H W 3"]:
    """The kernel's picture, planar in memory."""
    color = torch.empty_like(job.image[:3])
    _kernels.environment_forward(job.view, job.colors, job.image, job.alpha, color)
    return color.permute(1, 2, 0)


def environment_gradients(
    job: EnvironmentJob, grad_color: Float[Tensor, "H W 3"]
) -> tuple[Float[Tensor, "H W 7"], Float[Tensor, "6 S S 3"]]:
    """By the planes, planar in memory, and by the logits."""
    of_image, of_logits = torch.empty_like(job.image), torch.empty_like(job.logits)
    upstream = grad_color.permute(2, 0, 1).contiguous()
    _kernels.environment_backward(
        job.view, job.colors, *border(job.logits.shape[1]), job.image, job.alpha, upstream, of_image, of_logits
    )
    return of_image.permute(1, 2, 0), of_logits
