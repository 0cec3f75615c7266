"""What the kernel that makes a mirror's channels takes."""

import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.kernel_limits import MIRROR_MAX_LATENTS


def kernel_takes(*columns: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU, and few enough latents, the last column."""
    kinds = {(column.dtype, column.device.type) for column in columns}
    return kinds == {(torch.float32, "cpu")} and columns[-1].shape[1] <= MIRROR_MAX_LATENTS


def mirror_view(camera: Camera, flip_below: float) -> _kernels.MirrorView:
    """What the kernel is told of a view."""
    return _kernels.MirrorView(camera=camera.native, flip_below=flip_below, smallest_length=SMALLEST_LENGTH)
