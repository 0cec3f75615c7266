"""A tiny scene as a person would have it on disk: PNG photographs and transforms_*.json, or as plain nerfstudio."""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from ringlight.core.camera import Camera
from tiny_scene import FIELD_OF_VIEW, tiny_scene


def write_tiny_scene(folder: Path, views: int = 6, size: int = 20) -> Path:
    """NeRF-Synthetic layout, RGBA."""
    scene = tiny_scene(views=views, size=size)
    for split, photographs in (("train", scene.train), ("test", scene.test)):
        (folder / split).mkdir(parents=True)
        frames = []
        for index, view in enumerate(photographs):
            Image.fromarray(view.load()).save(folder / split / f"r_{index}.png")
            frames.append({"file_path": f"./{split}/r_{index}", "transform_matrix": opengl_pose(view.camera)})
        document = {"camera_angle_x": FIELD_OF_VIEW, "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(document))
    return folder


def opengl_pose(camera: Camera) -> list[list[float]]:
    """Camera to world, y up and z backward."""
    flip = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
    pose: list[list[float]] = (torch.linalg.inv(camera.world_to_camera) @ flip).tolist()
    return pose


def edit_json(path: Path, change) -> None:  # type: ignore[no-untyped-def]
    """Apply ``change`` to the parsed document in place and write it back."""
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.array(image)
