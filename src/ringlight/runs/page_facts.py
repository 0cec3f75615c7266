"""What a page says of a model: its words, and where to look from."""

import io
import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.visible_text import visible
from ringlight.core.want import Want
from ringlight.core.words import MEGABYTE, numbered
from ringlight.files.layer_pictures import common_depth_range, looking
from ringlight.files.orbit import orbit_of
from ringlight.files.page.shown import Shown
from ringlight.methods.store import StoredModel
from ringlight.models.splats import SplatModel

MOST_STOPS = 100
"""Training cameras that a page keeps, evenly spread."""

STILL_SIDE, STILL_QUALITY = 400, 60
"""Longer side in pixels, and quality, of the JPEG for browsers that cannot draw the model: 8 to 20 kB."""


def background_of(stored: StoredModel) -> Float[Tensor, "3"]:
    """What the model's pictures lie over: white unless it was trained over black."""
    return torch.zeros(3) if stored.header.scene.background == "black" else torch.ones(3)


def stops_of(cameras: Sequence[Camera]) -> dict[str, Camera]:
    """The training cameras that a page keeps, by name: "train-" and their number among all."""
    count = min(len(cameras), MOST_STOPS)
    numbers = [index * len(cameras) // count for index in range(count)]
    return {f"train-{number}": cameras[number] for number in numbers}


def numbers_of_stops(stops: dict[str, Camera]) -> Float[Tensor, "M 18"]:
    """Of each camera the pose's three rows of four, focal lengths, centre and size, in pixels."""
    rows = [
        [*camera.pose_numbers, *camera.focal, *camera.center, camera.width, camera.height] for camera in stops.values()
    ]
    return torch.tensor(rows, dtype=torch.float32).reshape(-1, 18)


def facts_of_page(stored: StoredModel, model: SplatModel, shown: Shown, stops: dict[str, Camera]) -> dict[str, Any]:
    """Everything but the caption and the number of Gaussians."""
    orbit = orbit_of(stored.cameras)
    near, far = common_depth_range(looking(model, background_of(stored), ("depth",)), stored.cameras)
    return {
        "kind": shown.kind,
        "flipBelow": shown.flip_below,
        "lit": shown.lit,
        "sizes": shown.sizes,
        **shown.settings,
        "antialiased": model.options.antialiased,
        "background": background_of(stored).tolist(),
        "nearFar": [near, far],
        "home": _camera(orbit.cameras(1)[0]),
        "center": orbit.center.tolist(),
        "up": orbit.up.tolist(),
        "cameraNames": list(stops),
    }


def _camera(camera: Camera) -> dict[str, list[float]]:
    return {
        "pose": camera.pose_numbers,
        "focal": list(camera.focal),
        "center": list(camera.center),
        "size": [camera.width, camera.height],
    }


def caption_of(stored: StoredModel, gaussians: int, bytes_page: int) -> dict[str, str]:
    """The words over the picture, by the part of the page that takes them."""
    psnr = measured_psnr(stored)
    return {
        "scene": visible(stored.header.scene.name),
        "method": visible(stored.header.preset),
        "psnr": "PSNR not measured" if psnr is None else f"{psnr:.2f} dB PSNR on test views",
        "size": f"{bytes_page / MEGABYTE:.2f} MB, {numbered(gaussians, 'Gaussians')}",
    }


def measured_psnr(stored: StoredModel) -> float | None:
    """Of the model on its test views, dB, as its file says."""
    found = stored.header.metrics.get("psnr")
    return float(found) if isinstance(found, int | float) and math.isfinite(found) else None


@torch.no_grad()
def still_of(stored: StoredModel, model: SplatModel) -> bytes:
    """A JPEG of what the page shows first."""
    camera = orbit_of(stored.cameras).cameras(1)[0]
    factor = STILL_SIDE / max(camera.width, camera.height)
    camera = camera.resized(*(max(round(side * factor), 1) for side in (camera.width, camera.height)))
    color = model.render(camera, background_of(stored), Want.PICTURE).color.cpu().clamp(0, 1)
    picture = Image.fromarray((color * 255).round().to(torch.uint8).contiguous().numpy())
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=STILL_QUALITY, optimize=True)
    return file.getvalue()
