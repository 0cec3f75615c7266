"""What the kernel that makes a mirror's channels takes."""

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH

MAX_LATENTS = 9
"""What the kernel takes: MIRROR_MAX_LATENTS in kernels/mirror_channels.hpp."""


def kernel_takes(*columns: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU, and few enough latents, the last column."""
    kinds = {(column.dtype, column.device.type) for column in columns}
    return kinds == {(torch.float32, "cpu")} and columns[-1].shape[1] <= MAX_LATENTS


def mirror_view(camera: Camera, flip_below: float) -> list[float]:
    """The camera as the kernel takes it."""
    return [*camera.position.tolist(), *camera.world_to_camera[2].tolist(), flip_below, SMALLEST_LENGTH]
