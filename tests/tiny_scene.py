"""A tiny scene made on the spot, for tests: shiny coloured balls, ray traced without any rasterizer.

Each ball has a matte colour and a highlight that moves with the viewer (Blinn-Phong under one distant light), so that
a view-dependent colour model has something to gain over a constant one.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8

from ringlight.core.camera import Camera
from ringlight.core.scene import PointCloud, Scene, View, camera_extent

BALLS = np.array(
    [
        # centre x, y, z; radius; red, green, blue
        [0.00, 0.00, 0.00, 0.50, 0.80, 0.25, 0.20],
        [0.75, 0.35, 0.10, 0.30, 0.20, 0.55, 0.85],
        [-0.60, 0.55, -0.15, 0.35, 0.25, 0.70, 0.30],
        [0.10, -0.75, 0.20, 0.30, 0.85, 0.75, 0.25],
    ]
)
"""The subject, world units."""

LIGHT = np.array([0.4, -0.3, 0.866])
"""Unit direction to the light; the world's up is z."""

AMBIENT, HIGHLIGHT, SHININESS = 0.35, 0.6, 24.0
"""Shade of the dark side, height of the highlight, and its exponent."""

RING_RADIUS, RING_ELEVATION = 3.0, 0.45
"""Where the cameras stand: distance from the origin in world units, elevation in radians."""

FIELD_OF_VIEW = 0.9
"""Radians, both ways."""

SAMPLES = 3
"""Rays per pixel and axis: edges of balls are then soft, as in photographs."""

POINTS_PER_BALL = 100
POINT_NOISE = 0.03
"""Points to start from: on each ball's surface, with this standard deviation in world units."""


@dataclass(frozen=True)
class _Traced:
    """Pixels behind the interface of a photograph."""

    pixels: UInt8[np.ndarray, "H W 4"]

    def __call__(self) -> UInt8[np.ndarray, "H W C"]:
        return self.pixels


def tiny_scene(views: int = 8, size: int = 24, seed: int = 0) -> Scene:
    """Balls seen by ``views`` training cameras in a ring and a quarter as many (at least 2) test cameras between them.

    Images are ``size`` pixels square, RGBA over white; ``seed`` turns the ring and draws the points. The same
    arguments give the same bits.
    """
    random = np.random.Generator(np.random.Philox(seed))
    turn = 2 * math.pi * random.random()
    tests = max(2, views // 4)
    # Half a step on, a test camera stands between two training cameras.
    halfway = math.pi / views
    train = _ring(np.arange(views) * 2 * math.pi / views + turn, size, "train")
    test = _ring(np.arange(tests) * 2 * math.pi / tests + turn + halfway, size, "test")
    return Scene(
        name="tiny",
        train=train,
        test=test,
        points=_surface_points(random),
        extent=camera_extent([view.camera for view in train]),
        box=torch.tensor([[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]),
        background="white",
        format="synthetic",
        source="made by tests/tiny_scene.py",
        notes=(f"images: {size}x{size} pixels, ray traced",),
    )


def _ring(azimuths: Float[np.ndarray, "V"], size: int, split: str) -> tuple[View, ...]:
    views = []
    for index, azimuth in enumerate(azimuths):
        # Every second camera looks from below, or the undersides would never be seen.
        elevation = RING_ELEVATION if index % 2 == 0 else -0.5 * RING_ELEVATION
        flat = RING_RADIUS * math.cos(elevation)
        position = [flat * math.cos(azimuth), flat * math.sin(azimuth), RING_RADIUS * math.sin(elevation)]
        camera = _camera_at(np.array(position), size)
        views.append(View(f"{split}/{index:03d}.png", camera, _Traced(trace(camera)), has_alpha=True))
    return tuple(views)


def _camera_at(position: Float[np.ndarray, "3"], size: int) -> Camera:
    """A camera that looks at the origin with the world's z upwards."""
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ position
    focal = 0.5 * size / math.tan(0.5 * FIELD_OF_VIEW)
    return Camera(torch.from_numpy(matrix.astype(np.float32)), (focal, focal), (size / 2, size / 2), size, size)


def trace(camera: Camera) -> UInt8[np.ndarray, "H W 4"]:
    """What ``camera`` sees of the balls: RGBA with straight alpha."""
    fine = camera.resized(camera.width * SAMPLES, camera.height * SAMPLES)
    directions = fine.ray_directions().numpy().astype(np.float64)
    origin = camera.position.numpy().astype(np.float64)
    distances = np.stack([_distances(origin, directions, ball) for ball in BALLS])
    nearest = distances.argmin(0)
    hit = np.isfinite(distances.min(0))
    points = origin + np.where(hit, distances.min(0), 0.0)[..., None] * directions
    colors = _shade(points, directions, BALLS[nearest]) * hit[..., None]
    shape = (camera.height, SAMPLES, camera.width, SAMPLES)
    alpha = hit.reshape(shape).mean((1, 3))
    premultiplied = colors.reshape(*shape, 3).mean((1, 3))
    straight = premultiplied / np.maximum(alpha, 1e-9)[..., None]
    return np.round(255 * np.concatenate([straight, alpha[..., None]], -1).clip(0, 1)).astype(np.uint8)


def _distances(
    origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "H W 3"], ball: Float[np.ndarray, "7"]
) -> Float[np.ndarray, "H W"]:
    """Along each unit ray to the near side of a ball, infinite where it is missed."""
    offset = origin - ball[:3]
    half = directions @ offset
    discriminant = half**2 - (offset @ offset - ball[3] ** 2)
    return np.where(discriminant > 0, -half - np.sqrt(np.maximum(discriminant, 0)), np.inf)


def _shade(
    points: Float[np.ndarray, "H W 3"], directions: Float[np.ndarray, "H W 3"], balls: Float[np.ndarray, "H W 7"]
) -> Float[np.ndarray, "H W 3"]:
    """Ambient and diffuse light on the ball's colour, and a white highlight."""
    normals = (points - balls[..., :3]) / balls[..., 3:4]
    halfway = LIGHT - directions
    halfway /= np.linalg.norm(halfway, axis=-1, keepdims=True)
    diffuse = AMBIENT + (1 - AMBIENT) * np.maximum(normals @ LIGHT, 0)
    highlight = HIGHLIGHT * np.maximum((normals * halfway).sum(-1), 0) ** SHININESS
    return (balls[..., 4:] * diffuse[..., None] + highlight[..., None]).clip(0, 1)


def _surface_points(random: np.random.Generator) -> PointCloud:
    normals = random.standard_normal((len(BALLS), POINTS_PER_BALL, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    positions = BALLS[:, None, :3] + BALLS[:, None, 3:4] * normals
    positions += POINT_NOISE * random.standard_normal(positions.shape)
    colors = np.broadcast_to(BALLS[:, None, 4:], positions.shape)
    rows = [torch.from_numpy(values.reshape(-1, 3).astype(np.float32)) for values in (positions, colors)]
    return PointCloud(positions=rows[0], colors=rows[1])
