"""Cameras at places, and what holds of every path."""

import math
from itertools import pairwise

import torch

from ringlight.core.camera import Camera

UP = torch.tensor([0.0, 0.0, 1.0])


def camera_at(position: torch.Tensor, target: torch.Tensor, focal: float = 100.0) -> Camera:
    forward = torch.nn.functional.normalize(target - position, dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, UP), dim=0)
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.stack([right, torch.linalg.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return Camera(matrix, (focal, focal), (32.0, 24.0), 64, 48)


def ring(count: int, target: torch.Tensor, radius: float = 3.0, height: float = 1.0) -> list[Camera]:
    angles = [2 * math.pi * i / count for i in range(count)]
    return [
        camera_at(target + torch.tensor([radius * math.cos(a), radius * math.sin(a), height]), target) for a in angles
    ]


def assert_rigid(path: list[Camera]) -> None:
    for camera in path:
        rotation = camera.world_to_camera[:3, :3]
        torch.testing.assert_close(rotation @ rotation.T, torch.eye(3), atol=1e-5, rtol=0)
        assert torch.linalg.det(rotation) > 0
        assert camera.world_to_camera.isfinite().all()


def largest_step(path: list[Camera]) -> float:
    return max((a.position - b.position).norm().item() for a, b in pairwise(path))
