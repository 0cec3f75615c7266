"""Small scenes on disk in each format, written by the tests themselves."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ringlight.errors import SceneError

WIDTH, HEIGHT = 16, 12
FOCAL = 20.0


def result_or_sentence(action: Callable[[], Any]) -> Any:
    """What ``action`` returns, or the message of the SceneError it raised; any other exception passes."""
    try:
        return action()
    except SceneError as error:
        return str(error)


def write_image(path: Path, size: tuple[int, int] = (WIDTH, HEIGHT), mode: str = "RGB", seed: int = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], len(mode)), dtype=np.uint8)
    Image.fromarray(pixels).save(path)


def write_mask(path: Path, size: tuple[int, int] = (WIDTH, HEIGHT), kept: bool = True, value: int = 255) -> None:
    """A mask that keeps the middle half of each side; or, unless ``kept``, drops it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((size[1], size[0]), 0 if kept else value, np.uint8)
    pixels[size[1] // 4 : -(size[1] // 4), size[0] // 4 : -(size[0] // 4)] = value if kept else 0
    Image.fromarray(pixels).save(path)


def look_at_origin(index: int, count: int = 9, distance: float = 4.0) -> np.ndarray:
    """OpenGL camera-to-world of one camera of a ring."""
    azimuth = 2 * math.pi * index / count
    position = distance * np.array([math.cos(azimuth), math.sin(azimuth), 0.5 + 0.1 * (index % 3)])
    backward = position / np.linalg.norm(position)
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(backward, right), backward, position], 1)
    return matrix


def frame(index: int, name: str) -> dict:
    return {"file_path": name, "transform_matrix": look_at_origin(index).tolist()}


def blender_document(split: str, count: int) -> dict:
    return {"camera_angle_x": 0.8, "frames": [frame(index, f"./{split}/r_{index}") for index in range(count)]}


def write_blender(folder: Path, train: int = 4, test: int = 2, mode: str = "RGBA") -> Path:
    for split, count in (("train", train), ("test", test)):
        for index in range(count):
            write_image(folder / split / f"r_{index}.png", mode=mode, seed=index)
        (folder / f"transforms_{split}.json").write_text(json.dumps(blender_document(split, count)))
    return folder


def nerfstudio_document(count: int = 9) -> dict:
    return {
        "camera_model": "OPENCV",
        "fl_x": FOCAL,
        "fl_y": FOCAL,
        "cx": WIDTH / 2,
        "cy": HEIGHT / 2,
        "w": WIDTH,
        "h": HEIGHT,
        "k1": 0.0,
        "aabb_scale": 16,
        "frames": [frame(index, f"images/{index:04d}.png") for index in range(count)],
    }


def write_nerfstudio(folder: Path, document: dict | None = None, count: int = 9) -> Path:
    for index in range(count):
        write_image(folder / "images" / f"{index:04d}.png", seed=index)
    (folder / "transforms.json").write_text(json.dumps(document or nerfstudio_document(count)))
    return folder


def colmap_names(count: int) -> list[str]:
    return [f"left/{index:03d}.png" if index % 2 else f"right/{index:03d}.png" for index in range(count)]


def colmap_pose(index: int) -> tuple[np.ndarray, np.ndarray]:
    """A quaternion wxyz and a translation, world to camera: cameras beside each other, turned a little."""
    angle = 0.1 * index
    quaternion = np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])
    return quaternion, np.array([0.2 * index, 0.0, 4.0])


def colmap_point(index: int) -> tuple[np.ndarray, tuple[int, int, int]]:
    return np.array([0.1 * index, -0.1 * index, 0.05 * index]), (index, 2 * index, 255 - index)


PINHOLE = ("PINHOLE", 1, (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2))
"""Model name, model number, parameters."""


def write_colmap_binary(model: Path, count: int = 9, camera: tuple = PINHOLE, points: int = 6) -> None:
    model.mkdir(parents=True, exist_ok=True)
    _, number, parameters = camera
    lens = struct.pack(f"<IiQQ{len(parameters)}d", 7, number, WIDTH, HEIGHT, *parameters)
    (model / "cameras.bin").write_bytes(struct.pack("<Q", 1) + lens)
    images = struct.pack("<Q", count)
    for index, name in enumerate(colmap_names(count)):
        quaternion, translation = colmap_pose(index)
        images += struct.pack("<I7dI", index + 1, *quaternion, *translation, 7) + name.encode() + b"\0"
        images += struct.pack("<Q2dQ2dQ", 2, 1.5, 2.5, 1, 3.5, 4.5, 2**64 - 1)
    (model / "images.bin").write_bytes(images)
    cloud = struct.pack("<Q", points)
    for index in range(points):
        position, color = colmap_point(index)
        cloud += struct.pack("<Q3d3BdQ", index + 1, *position, *color, 0.5, 2) + struct.pack("<4I", 1, 0, 2, 1)
    (model / "points3D.bin").write_bytes(cloud)


def write_colmap_text(model: Path, count: int = 9, camera: tuple = PINHOLE, points: int = 6) -> None:
    model.mkdir(parents=True, exist_ok=True)
    name, _, parameters = camera
    lens = " ".join(str(value) for value in parameters)
    (model / "cameras.txt").write_text(f"# Number of cameras: 1\n7 {name} {WIDTH} {HEIGHT} {lens}\n")
    lines = [f"# Number of images: {count}, mean observations per image: 1"]
    for index, image in enumerate(colmap_names(count)):
        quaternion, translation = colmap_pose(index)
        numbers = " ".join(repr(float(value)) for value in [*quaternion, *translation])
        # Every second image has no observations: its second line is empty.
        lines += [f"{index + 1} {numbers} 7 {image}", "1.5 2.5 1 3.5 4.5 -1" if index % 2 else ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [f"# Number of points: {points}, mean track length: 2"]
    for index in range(points):
        position, color = colmap_point(index)
        numbers = " ".join(repr(float(value)) for value in position)
        lines.append(f"{index + 1} {numbers} {' '.join(map(str, color))} 0.5 1 0 2 1")
    (model / "points3D.txt").write_text("\n".join(lines) + "\n")


def write_photographs(folder: Path, count: int = 9, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
    for index, name in enumerate(colmap_names(count)):
        write_image(folder / name, size, seed=index)


def write_colmap(folder: Path, count: int = 9, camera: tuple = PINHOLE, text: bool = False) -> Path:
    write_photographs(folder / "images", count)
    (write_colmap_text if text else write_colmap_binary)(folder / "sparse" / "0", count, camera)
    return folder
