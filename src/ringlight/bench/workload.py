"""The standard rasterization workload: one random ball of Gaussians, seen by one camera; the same on every machine."""

import math
import re
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.scene import PointCloud, Scene, View
from ringlight.errors import RecipeError
from ringlight.fit.strategies.morton import morton_order

MEDIAN_SCALE, SCALE_SIGMA = 0.012, 0.5
"""Standard deviations are lognormal: a trained scene's mixture of small and large, world units."""
OPACITIES = (0.05, 0.95)
CAMERA_DISTANCE = 4.0
TURN_Y, TURN_X = 0.3, -0.2
"""Radians; no axis of the world is an axis of the image."""
FIELD_OF_VIEW = math.radians(40)

SIZE = re.compile(r"(\d+)(k?)@(\d+)")
MOST_GAUSSIANS, MOST_PIXELS = 5_000_000, 8192
"""A slip of the finger should not ask for hundreds of gigabytes."""


@dataclass(frozen=True)
class Size:
    """How much is drawn: Gaussians, pixels on a side of the square image, blended channels."""

    gaussians: int
    pixels: int
    channels: int = 3

    @staticmethod
    def parse(text: str, channels: int = 3) -> "Size":
        """From "100k@400". Raises RecipeError for anything else."""
        found = SIZE.fullmatch(text.strip().lower())
        if found is None:
            raise RecipeError(f"{text!r} is no size; write Gaussians@pixels, as in 100k@400")
        size = Size(int(found[1]) * (1000 if found[2] else 1), int(found[3]), channels)
        if not (1 <= size.gaussians <= MOST_GAUSSIANS and 1 <= size.pixels <= MOST_PIXELS and channels >= 1):
            raise RecipeError(
                f"{text!r} with {channels} channels is out of range; "
                f"give up to {MOST_GAUSSIANS // 1000}k Gaussians, {MOST_PIXELS} pixels, and a channel or more"
            )
        return size

    @property
    def name(self) -> str:
        """As people write it: "100k@400"."""
        thousands, rest = divmod(self.gaussians, 1000)
        return f"{thousands}k@{self.pixels}" if thousands and not rest else f"{self.gaussians}@{self.pixels}"


@dataclass(frozen=True)
class Workload:
    """``channels`` [N C] in [0, 1]; the table is in Morton order, as training keeps it."""

    size: Size
    gaussians: Gaussians
    channels: Float[Tensor, "N C"]
    camera: Camera


def workload(size: Size, seed: int = 0) -> Workload:
    """The workload of that size: a pure function of its arguments."""
    draw = generator(seed, 0, f"workload {size.name}")
    count = size.gaussians
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=draw), dim=-1)
    means = directions * torch.rand(count, 1, generator=draw).pow(1 / 3)
    log_scales = math.log(MEDIAN_SCALE) + SCALE_SIGMA * torch.randn(count, 3, generator=draw)
    quats = torch.nn.functional.normalize(torch.randn(count, 4, generator=draw), dim=-1)
    low, high = OPACITIES
    opacities = low + (high - low) * torch.rand(count, generator=draw)
    channels = torch.rand(count, size.channels, generator=draw)
    order = morton_order(means)
    table = Gaussians(means, log_scales, quats, opacities.logit()).rows(order)
    return Workload(size, table, channels[order].contiguous(), workload_camera(size.pixels))


def workload_camera(pixels: int, turn_y: float = TURN_Y) -> Camera:
    """Looks at the middle of the ball: the world is turned about y, then about x, then moved away along z."""
    cos_y, sin_y, cos_x, sin_x = math.cos(turn_y), math.sin(turn_y), math.cos(TURN_X), math.sin(TURN_X)
    about_y = torch.tensor([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]])
    about_x = torch.tensor([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
    matrix = torch.eye(4)
    matrix[:3, :3] = about_x @ about_y
    matrix[2, 3] = CAMERA_DISTANCE
    focal = 0.5 * pixels / math.tan(0.5 * FIELD_OF_VIEW)
    return Camera(matrix, (focal, focal), (pixels / 2, pixels / 2), pixels, pixels)


def workload_scene(work: Workload, seed: int = 0) -> Scene:
    """One photograph of noise from the workload's camera, and its centres as points: for timing training steps."""
    pixels = work.size.pixels
    noise = np.random.default_rng(seed).integers(0, 256, (pixels, pixels, 3), dtype=np.uint8)
    return Scene(
        name=f"workload {work.size.name}",
        train=(View("noise", work.camera, lambda: noise),),
        test=(),
        points=PointCloud(work.gaussians.means, work.channels),
        extent=CAMERA_DISTANCE,
        box=torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]),
        background="white",
        format="workload",
        source="",
    )
