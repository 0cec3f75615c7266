"""Where Gaussians start, and the box that holds the subject.

Structure-from-motion points if the scene brings some; else uniformly random points in a cube around what the cameras
look at. The cube comes from the cameras alone: its centre is the point nearest to all optical axes, its unit the
distance from it to the edge of the typical picture in the narrower direction. On NeRF-Synthetic the radius
is 1.45, so that 0.9 of it is the ±1.3 in which 3DGS draws its 100000 points; a scene in other units gets the
same share of its own frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.scene import SMALLEST_EXTENT, PointCloud, camera_extent
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions

POINTS_SHARE = 0.9
"""Half side of the cube of random points over the seen radius: ±1.3 on NeRF-Synthetic, as 3DGS."""

BOX_SHARE = 1.1
"""Half side of the scene's box over the seen radius: ±1.6 on NeRF-Synthetic, which leaves Gaussians room to move."""

OUTLIER_PERCENT = 2.0
"""SfM points left out at either end of each axis when the box is drawn: sky and mismatches lie there."""

BOX_MARGIN = 0.1
"""Added to each side of the SfM box, relative to its length."""

THINNEST_SIDE = 0.05
"""Shortest side of a box over its longest, so that positions in a flat scene can still be normalised."""

FEWEST_POINTS = 4
"""SfM points needed to start: first scales come from three neighbours."""

FEWEST_FOR_BOX = 100
"""SfM points needed for percentiles to mean something; with fewer the box comes from the cameras."""

PARALLEL_AXES = 1e-3
"""Mean squared sine between the optical axes below which they have no common point (about two degrees)."""

SURROUNDINGS = 3.0
"""Half side of the cube, in camera extents, around cameras that do not look at one point."""

SMALL_SIDE = 200
"""Images up to this many pixels a side start from fewer random points: they have too few pixels to place more."""

SMALL_COUNT = 20_000
"""Random points for those: half as many as such an image has pixels."""

LARGEST_COUNT = 100_000
"""Random points for larger images, as 3DGS."""

FAINT_COLOR = 0.28209479 / 255
"""Range of the random colours above mid grey: 3DGS's tiny random coefficients times the constant harmonic."""


@dataclass(frozen=True)
class SeenSphere:
    """What the cameras look at: ``radius`` reaches from ``center`` to the edge of the typical picture, world units."""

    center: Float[np.ndarray, "3"]
    radius: float

    def cube(self, share: float) -> Float[Tensor, "2 3"]:
        """Lowest and highest corner of the cube of half side ``share`` times the radius."""
        half = share * self.radius
        return torch.from_numpy(np.stack([self.center - half, self.center + half]).astype(np.float32))


def starting_points(
    sfm: PointCloud | None, cameras: Sequence[Camera], options: SceneOptions
) -> tuple[PointCloud, Float[Tensor, "2 3"], str]:
    """Points to start from, the scene's box, and a note on where the points come from; never empty."""
    sphere = seen_sphere(cameras)
    if sfm is not None and len(sfm.positions) >= FEWEST_POINTS:
        enough = len(sfm.positions) >= FEWEST_FOR_BOX
        box = sfm_box(sfm.positions) if enough else sphere.cube(BOX_SHARE)
        return sfm, box, f"initial points: {len(sfm.positions)} from structure from motion"
    count = options.initial_points or default_count(cameras)
    points = random_points(sphere.cube(POINTS_SHARE), count, options.points_seed)
    place = ", ".join(f"{round(value, 3) + 0.0:g}" for value in sphere.center)  # + 0.0: no minus before zero
    brought = "no points" if sfm is None else counted(len(sfm.positions), "point")
    note = (
        f"initial points, where no first surface is carved from masks or an even background: {count} random in a cube "
        f"of half side {POINTS_SHARE * sphere.radius:.3g} around ({place}), seed {options.points_seed}, "
        f"since the scene brings {brought}"
    )
    return points, sphere.cube(BOX_SHARE), note


def scene_extent(cameras: Sequence[Camera], box: Float[Tensor, "2 3"]) -> float:
    """The cameras' extent, or half the box's longest side where they stand in one place: a single photograph.

    Rates and sizes that count in extents would otherwise freeze the centres and prune every Gaussian.
    """
    extent = camera_extent(list(cameras))
    return extent if extent > SMALLEST_EXTENT else 0.5 * (box[1] - box[0]).max().item()


def default_count(cameras: Sequence[Camera]) -> int:
    """How many random points suit images of this size."""
    side = max(max(camera.width, camera.height) for camera in cameras)
    return SMALL_COUNT if side <= SMALL_SIDE else LARGEST_COUNT


def random_points(box: Float[Tensor, "2 3"], count: int, seed: int) -> PointCloud:
    """``count`` points uniform in ``box``, of a grey that is faintly random; the same for the same seed everywhere."""
    draws = torch.from_numpy(np.random.Generator(np.random.Philox(seed)).random((2, count, 3), dtype=np.float32))
    low, high = box
    return PointCloud(low + (high - low) * draws[0], 0.5 + FAINT_COLOR * draws[1], origin="random")


def sfm_box(positions: Float[Tensor, "P 3"]) -> Float[Tensor, "2 3"]:
    """The box of the central points along each axis, enlarged a little."""
    percents = [OUTLIER_PERCENT, 100 - OUTLIER_PERCENT]
    low, high = np.percentile(positions.numpy().astype(np.float64), percents, axis=0)
    sides = (high - low) * (1 + 2 * BOX_MARGIN)
    sides = np.maximum(sides, max(THINNEST_SIDE * sides.max(), 1e-6))
    center = (low + high) / 2
    return torch.from_numpy(np.stack([center - sides / 2, center + sides / 2]).astype(np.float32))


def seen_sphere(cameras: Sequence[Camera]) -> SeenSphere:
    """What the cameras look at; where they do not look at one point, a sphere around the cameras themselves."""
    positions = np.stack([camera.position.numpy() for camera in cameras]).astype(np.float64)
    axes = np.stack([camera.forward.numpy() for camera in cameras]).astype(np.float64)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    spread = across.mean(0)
    if np.linalg.eigvalsh(spread)[0] > PARALLEL_AXES:
        center = np.linalg.solve(spread, (across @ positions[:, :, None]).mean(0))[:, 0]
        depths = ((center - positions) * axes).sum(1)
        tangents = [min(camera.width / camera.focal[0], camera.height / camera.focal[1]) / 2 for camera in cameras]
        radius = float(np.median(depths * np.array(tangents)))
        if np.median(depths) > 0 and radius > 0:
            return SeenSphere(center, radius)
    extent = camera_extent(list(cameras))
    return SeenSphere(positions.mean(0), SURROUNDINGS * extent if extent > SMALLEST_EXTENT else 1.0)
