"""Blended buffers as a rasterizer leaves them, planar, for tests of shaders."""

import math

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.rendering import Channels

BOX = torch.tensor([[-1.0, -1.2, -0.9], [1.1, 1.0, 1.3]])


def camera(width: int = 13, height: int = 9, turn: float = 0.4) -> Camera:
    """A camera 3 units from the origin, looking at it from the side."""
    pose = torch.eye(4)
    pose[0, 0], pose[0, 2], pose[2, 0], pose[2, 2] = math.cos(turn), -math.sin(turn), math.sin(turn), math.cos(turn)
    pose[2, 3] = 3.0
    return Camera(pose, (1.1 * width, 1.2 * width), (0.5 * width + 0.3, 0.5 * height - 0.2), width, height)


def buffers(view: Camera, latents: int = 4, seed: int = 0, dtype: torch.dtype = torch.float32) -> Channels:
    """Pixels of any opacity, a fifth of them empty; normals towards the camera, more or less."""
    drawn = torch.Generator().manual_seed(seed)
    height, width = view.height, view.width

    def uniform(channels: int, low: float = 0.0, high: float = 1.0) -> Tensor:
        return torch.rand(channels, height, width, generator=drawn, dtype=torch.float64) * (high - low) + low

    alpha = uniform(1, 0.1)
    alpha = torch.where(uniform(1) < 0.2, 0, alpha)
    normals = normalize(uniform(3, -1, 1).permute(1, 2, 0) - 1.5 * view.forward.double()).permute(2, 0, 1)
    planes = {
        "rgb": uniform(3),
        "normal": normals * alpha * uniform(1, 0.5),
        "latents": uniform(latents, -1, 1) * alpha,
        "depth": uniform(1, 2, 4) * alpha,
        "alpha": alpha,
    }
    return {name: plane.to(dtype).contiguous().permute(1, 2, 0) for name, plane in planes.items()}
