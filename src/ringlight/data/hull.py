"""The visual hull: what the alpha masks leave of space, and points with outward normals on its surface.

Laurentini, The Visual Hull Concept, 1994. A model that is shaded after blending needs an opaque surface from its first
step: through a faint one the backs of other Gaussians shine, and their normals blend to nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.scene import View

COARSE_CELLS, FINE_CELLS = 64, 160
"""Voxels along the longest side: of the scene's box, to find the subject, and then of the subject's own box."""

MOST_VIEWS = 120
"""Photographs that carve; more of them cost time and shave off little."""

OPAQUE = 0.5
"""Alpha above which a pixel shows the subject."""

SEEN_SHARE = 0.7
"""A voxel counts only if it lies inside the image in this share of the views: beyond their borders nothing carves."""

EMPTY_SHARE = 0.02
"""Share of transparent pixels below which photographs are taken to have no mask."""

SMOOTHING = 1.5
"""Standard deviation, in voxels, of the blur whose gradient gives normals: a bare staircase has six of them."""


@dataclass(frozen=True)
class Hull:
    """Surface voxels of the hull: ``positions`` on the smoothed surface, unit outward ``normals``; ``pitch`` is the
    side of a voxel, world units."""

    positions: Float[Tensor, "S 3"]
    normals: Float[Tensor, "S 3"]
    pitch: float


@dataclass(frozen=True)
class Mask:
    """Where one photograph shows the subject."""

    camera: Camera
    subject: Bool[Tensor, "H W"]


def masks_of(views: Sequence[View]) -> list[Mask]:
    """The views' masks, of at most MOST_VIEWS of them, evenly chosen; none where the photographs have no mask."""
    chosen = [views[index] for index in np.linspace(0, len(views) - 1, min(len(views), MOST_VIEWS)).astype(int)]
    if not all(view.has_alpha for view in chosen):
        return []
    masks = [Mask(view.camera, torch.from_numpy(view.load()[..., 3] > OPAQUE * 255)) for view in chosen]
    empty = sum(float((~mask.subject).float().mean()) for mask in masks) / len(masks)
    return masks if empty >= EMPTY_SHARE else []


def visual_hull(masks: Sequence[Mask], box: Float[Tensor, "2 3"]) -> Hull | None:
    """The hull inside ``box``, world units; None where the masks leave nothing, or there are none."""
    if not masks:
        return None
    coarse = _Grid.over(box, COARSE_CELLS)
    subject = coarse.bounds(carve(coarse.centers(), masks, coarse.pitch))
    if subject is None:
        return None
    fine = _Grid.over(subject, FINE_CELLS)
    return _surface(fine, carve(fine.centers(), masks).view(fine.shape))


def carve(points: Float[Tensor, "P 3"], masks: Sequence[Mask], margin: float = 0.0) -> Bool[Tensor, "P"]:
    """Which points no mask carves away; masks are widened by ``margin``, world units.

    Without a margin the surface lies where the silhouettes are: one pixel outside costs several dB at the start.
    """
    alive, views_inside = torch.arange(len(points)), torch.zeros(len(points))
    for mask in masks:
        camera, here = mask.camera, points[alive]
        matrix = camera.world_to_camera
        x, y, z = (here @ matrix[:3, :3].T + matrix[:3, 3]).unbind(-1)
        column = (camera.focal[0] * x / z + camera.center[0]).floor()
        row = (camera.focal[1] * y / z + camera.center[1]).floor()
        inside = (z > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        if not bool(inside.any()):
            continue
        subject = _widened(mask.subject, margin * max(camera.focal) / float(z[inside].median()))
        index = (row[inside] * camera.width + column[inside]).long()
        stays = ~inside
        stays[inside] = subject.flatten()[index]
        views_inside[alive] += inside
        alive = alive[stays]
    kept = torch.zeros(len(points), dtype=torch.bool)
    kept[alive] = views_inside[alive] >= SEEN_SHARE * len(masks)
    return kept


def _widened(subject: Bool[Tensor, "H W"], pixels: float) -> Bool[Tensor, "H W"]:
    reach = math.ceil(pixels)
    if not reach:
        return subject
    return torch.nn.functional.max_pool2d(subject.float()[None], 2 * reach + 1, 1, reach)[0] > 0


@dataclass(frozen=True)
class _Grid:
    """Cubic voxels: the centre of the first, the side of each, and how many along each axis."""

    first: Float[Tensor, "3"]
    pitch: float
    shape: tuple[int, int, int]

    @staticmethod
    def over(box: Float[Tensor, "2 3"], cells: int) -> "_Grid":
        """``cells`` voxels along the longest side of ``box``."""
        sides = box[1] - box[0]
        pitch = float(sides.max()) / cells
        x, y, z = (max(int(np.ceil(float(side) / pitch - 1e-4)), 1) for side in sides)
        return _Grid(box[0] + 0.5 * pitch, pitch, (x, y, z))

    def centers(self) -> Float[Tensor, "P 3"]:
        axes = [self.first[axis] + self.pitch * torch.arange(count) for axis, count in enumerate(self.shape)]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).view(-1, 3)

    def bounds(self, occupied: Bool[Tensor, "P"]) -> Float[Tensor, "2 3"] | None:
        """The box of the occupied voxels and two more on each side, which the blur of the surface needs."""
        cells = occupied.view(self.shape).nonzero()
        if not len(cells):
            return None
        low, high = cells.amin(0) - 2.5, cells.amax(0) + 2.5
        return self.first + self.pitch * torch.stack([low, high])


def _surface(grid: _Grid, occupied: Bool[Tensor, "X Y Z"]) -> Hull | None:
    """Occupied voxels with a free neighbour, moved along their normal to where the blurred occupancy is a half."""
    solid = occupied.numpy()
    border = torch.from_numpy(solid & ~ndimage.binary_erosion(solid, np.ones((3, 3, 3))))
    if not bool(border.any()):
        return None
    blurred = ndimage.gaussian_filter(solid.astype(np.float32), SMOOTHING)
    slope = torch.stack([torch.from_numpy(part)[border] for part in np.gradient(blurred)], -1)
    steepness = slope.norm(dim=-1)
    normals = normalize(-slope)
    outwards = ((torch.from_numpy(blurred)[border] - 0.5) / steepness.clamp_min(1e-3)).clamp(-1, 1)
    centers = grid.first + grid.pitch * border.nonzero()
    return Hull(centers + grid.pitch * outwards[:, None] * normals, normals, grid.pitch)
