"""Files of true normals, for tests: as the format says, and of a scene whose surfaces are known."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from tiny_scene import BALLS


def ball_normals(camera: Camera) -> np.ndarray:
    """World normals [H W 3] of the tiny scene's balls at pixel centres, zero where none is hit."""
    rays, origin = camera.ray_directions().numpy().astype(np.float64), camera.position.numpy().astype(np.float64)
    nearest, normals = np.full(rays.shape[:2], np.inf), np.zeros(rays.shape)
    for ball in BALLS:
        offset = origin - ball[:3]
        half = rays @ offset
        under = half**2 - (offset @ offset - ball[3] ** 2)
        distance = np.where(under > 0, -half - np.sqrt(np.maximum(under, 0)), np.inf)
        first = distance < nearest
        points = origin + distance[first][:, None] * rays[first]
        normals[first], nearest[first] = (points - ball[:3]) / ball[3], distance[first]
    return normals


def stored(normals: np.ndarray) -> np.ndarray:
    return np.rint(normals * 32767).astype(np.int16)


def arrays_of(scene: Scene) -> dict[str, Any]:
    """What a legal file of this scene's test views holds."""
    names = [Path(view.name).stem for view in scene.test]
    return {"normals": stored(np.stack([ball_normals(view.camera) for view in scene.test])), "names": np.array(names)}


def write_truth(path: Path, scene: Scene, **others: Any) -> Path:
    """``others`` take the place of arrays; None leaves one out."""
    arrays = {name: array for name, array in (arrays_of(scene) | others).items() if array is not None}
    np.savez_compressed(path, **arrays)
    return path


def turned(normals: np.ndarray, degrees: float) -> np.ndarray:
    """Each unit normal turned by so many degrees about an axis at right angles to it; zeros stay."""
    vectors = torch.from_numpy(normals)
    helper = torch.where(vectors[..., :1].abs() < 0.9, torch.tensor([1.0, 0, 0]), torch.tensor([0.0, 1, 0]))
    across = torch.nn.functional.normalize(torch.cross(vectors, helper.to(vectors), dim=-1), dim=-1)
    angle = np.radians(degrees)
    return np.asarray(vectors * np.cos(angle) + across * np.sin(angle))
