"""Photographs of a corner of a room, cast ray by ray: structure from motion finds its cameras, which are known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
TEXELS = 512
ROOM = 4.0
"""Side of floor and walls, world units."""


@dataclass(frozen=True)
class Shot:
    """``rotation`` takes world axes to right, down, forward."""

    center: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]


def texture(seed: int) -> Float[np.ndarray, "T T 3"]:
    """Blobs of all sizes: what SIFT sees best."""
    rng = np.random.default_rng(seed)
    total = np.zeros((TEXELS, TEXELS, 3))
    for cells in (16, 32, 64, 128, 256):
        noise = rng.integers(0, 256, (cells, cells, 3)).astype(np.uint8)
        total += np.asarray(Image.fromarray(noise).resize((TEXELS, TEXELS), Image.Resampling.BICUBIC), float)
    return np.clip((total / 5 - 128) * 2 + 128, 0, 255)


def shots(count: int, roll: float = 0.0) -> list[Shot]:
    """On an arc in front of the corner, each looking at its middle; level but for ``roll``, radians."""
    found = []
    for index, angle in enumerate(np.linspace(np.pi * 1.06, np.pi * 1.44, count)):
        center = np.array([ROOM, ROOM, 0.0]) + 4.0 * np.array([np.cos(angle), np.sin(angle), 0.35 + 0.05 * (index % 3)])
        forward = np.array([ROOM - 0.6, ROOM - 0.6, 0.7]) - center
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        cos, sin = np.cos(roll), np.sin(roll)
        found.append(Shot(center, np.stack([cos * right + sin * down, cos * down - sin * right, forward])))
    return found


def photograph(shot: Shot, seed: int = 0) -> UInt8[np.ndarray, "H W 3"]:
    """What the floor z = 0 and the walls x = ROOM and y = ROOM look like from there."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    rays = np.stack([(x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL, np.ones_like(x)], -1) @ shot.rotation
    nearest = np.full((HEIGHT, WIDTH), np.inf)
    picture = np.full((HEIGHT, WIDTH, 3), 128.0)
    for axis, level in ((2, 0.0), (0, ROOM), (1, ROOM)):
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (level - shot.center[axis]) / rays[..., axis]
        hit = (depth > 0) & (depth < nearest)
        place = (shot.center + depth[..., None] * rays)[..., [a for a in range(3) if a != axis]]
        picture[hit] = _bilinear(texture(10 * seed + axis), place[hit] / ROOM * (TEXELS - 1))
        nearest[hit] = depth[hit]
    return np.round(picture).astype(np.uint8)


def save_photographs(folder: Path, count: int, seed: int = 0, prefix: str = "shot") -> list[Shot]:
    """PNGs called PREFIX_00.png and so on."""
    folder.mkdir(parents=True, exist_ok=True)
    taken = shots(count)
    for index, shot in enumerate(taken):
        Image.fromarray(photograph(shot, seed)).save(folder / f"{prefix}_{index:02d}.png")
    return taken


def _bilinear(image: Float[np.ndarray, "T T 3"], place: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 3"]:
    place = np.clip(place, 0, TEXELS - 1.001)
    (row, column), part = np.floor(place).astype(int).T, (place % 1)
    down, across = part[:, :1], part[:, 1:]
    top = image[row, column] * (1 - across) + image[row, column + 1] * across
    bottom = image[row + 1, column] * (1 - across) + image[row + 1, column + 1] * across
    return top * (1 - down) + bottom * down
