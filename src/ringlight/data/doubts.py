"""What is odd about a scene's points and cameras, said before a training comes out blank."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.scene import PointCloud

SAMPLES = 2000
"""Points that are looked for in the photographs, evenly chosen."""

SEEN_SHARE = 0.5
"""Of the points; COLMAP's are all seen by two photographs, which may be test views."""

FAR = 100.0
"""Times the median distance from the middle of the cameras at which one is believed to be misplaced."""

NEAREST = 0.01
"""World units from a camera's plane at which rasterizers begin to draw: NEAR of rasterize/convention.py."""

WANTED_DEPTH = 4.0
"""World units at which points lie once a scene is scaled as a warning says: about as in NeRF-Synthetic."""

FROM_ORIGIN = 1e5
"""Times the distance of cameras from what they see that their middle may lie off the origin. The bundled toaster loses
0.1 dB at a quarter of it and 1 dB at two and a half times as much, for single precision blurs positions."""

INWARDS = 0.5
"""Mean cosine between viewing axes and directions to the cameras' middle, of cameras that stand around a subject."""

CLOSE = 1e-6
"""Spread of points over their distance from the cameras below which all lie in one place."""


def doubts(points: PointCloud, names: Sequence[str], cameras: Sequence[Camera]) -> Iterator[str]:
    """Warnings. ``names`` are those of the cameras' photographs. Random points are nobody's mistake: many lie where no
    camera looks."""
    yield from _about_cameras(names, cameras)
    count = min(len(points.positions), SAMPLES)
    chosen = points.positions[torch.arange(count) * len(points.positions) // count]
    depths = torch.cat([camera.depths(chosen)[camera.pixels(chosen)[2]] for camera in cameras])
    if len(depths) and (points.measured or _stand_around(cameras)):
        yield from _about_units(depths)
        yield from _about_origin(np.median(_positions(cameras), axis=0), float(depths.median()))
    if points.measured:
        yield from _about_points(chosen, cameras)


def _stand_around(cameras: Sequence[Camera]) -> bool:
    """Whether cameras look towards their middle. Random points lie around that then; where cameras turn in one place
    they lie where those stand."""
    inwards = np.median(_positions(cameras), axis=0) - _positions(cameras)
    axes = np.stack([camera.forward.numpy() for camera in cameras])
    cosines = (inwards * axes).sum(1) / np.linalg.norm(inwards, axis=1).clip(SMALLEST_LENGTH)
    return float(cosines.mean()) > INWARDS


def _positions(cameras: Sequence[Camera]) -> np.ndarray:
    return np.stack([camera.position.numpy() for camera in cameras]).astype(np.float64)


def _about_units(depths: Float[Tensor, "P"]) -> Iterator[str]:
    """Rasterizers leave out what is nearer than NEAREST, whatever a scene's unit."""
    if float((depths < NEAREST).float().mean()) > 1 - SEEN_SHARE:
        factor = 10 ** round(math.log10(WANTED_DEPTH / float(depths.median())))
        yield (
            f"warning: most of what the cameras see lies nearer than {NEAREST:g} world units, where Gaussians are not "
            f"drawn; multiply all positions, of cameras and points, by {factor:,}"
        )


def _about_origin(middle: np.ndarray, across: float) -> Iterator[str]:
    """``across`` is how far cameras stand from what they see."""
    away = float(np.linalg.norm(middle))
    if away > FROM_ORIGIN * across:
        digits = max(-math.floor(math.log10(across)), 0)
        moved = ", ".join(f"{value:.{digits}f}" for value in middle)
        yield (
            f"warning: the cameras stand {away / across:,.0f} times as far from the origin as from what they see, and "
            f"single precision blurs that; subtract {moved} from all positions, of cameras and points"
        )


def _about_points(chosen: Float[Tensor, "P 3"], cameras: Sequence[Camera]) -> Iterator[str]:
    seen = torch.zeros(len(chosen), dtype=torch.bool)
    for camera in cameras:
        seen |= camera.pixels(chosen)[2]
    share = float(seen.float().mean())
    if share < SEEN_SHARE:
        what = "all points to start from are" if share == 0 else f"{1 - share:.0%} of the points to start from are"
        yield f"warning: {what} seen by no camera; poses and points may be of different worlds, or their axes exchanged"
    spread = (chosen - chosen.mean(0)).norm(dim=1).max()
    away = (cameras[0].position - chosen.mean(0)).norm()
    if len(chosen) > 1 and spread <= CLOSE * away:
        yield "warning: all points to start from lie in one place; export the points again"


def _about_cameras(names: Sequence[str], cameras: Sequence[Camera]) -> Iterator[str]:
    positions = _positions(cameras)
    distances = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    typical, farthest = float(np.median(distances)), int(distances.argmax())
    if typical > 0 and distances[farthest] > FAR * typical:
        times = distances[farthest] / typical
        yield (
            f"warning: the camera of {names[farthest]} stands {times:.3g} times as far from the others' middle as they "
            "do; leave its photograph out if its pose is wrong"
        )
