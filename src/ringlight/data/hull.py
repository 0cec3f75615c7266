"""The visual hull: what the alpha masks leave of space, points with outward normals on its surface, and any in it.

Laurentini, The Visual Hull Concept, 1994. A model that is shaded after blending needs an opaque surface from its first
step: through a faint one the backs of other Gaussians shine, and their normals blend to nothing.
"""

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
from ringlight.core.stages import counted

COARSE_CELLS, FINE_CELLS = 64, 160
"""Voxels along the longest side: of the scene's box, to find the subject, and then of the subject's own box."""

BLURRED = 2
"""Voxels around a subject that the blur of its surface needs."""

MOST_VIEWS = 120
"""Photographs that carve; more of them cost time and shave off little."""

OPAQUE = 0.5
"""Alpha above which a pixel shows the subject."""

SEEN_SHARE = 0.7
"""A voxel counts only if it lies inside the image in this share of the views: beyond their borders nothing carves."""

EMPTY_SHARE = 0.02
"""Share of transparent pixels below which photographs are taken to have no mask."""

PARTLY = 0.02
"""Pixels whose alpha is this far from 0 and 1 are cut by the silhouette."""

SILHOUETTE_BLUR = 1.0
"""Standard deviation, in pixels, of the blur that takes the staircase out of a silhouette."""

BAND = 4.0
"""Voxels on both sides of the surface within which depths are known; as far as the blur reaches."""

SMOOTHING = 1.5
"""Standard deviation, in voxels, of the blur whose gradient gives normals."""

FLATTEST_SLOPE = 0.3
"""Least slope of the depth that is believed where voxels are moved onto the surface: where cones of several views meet
in a ridge the blur flattens it."""


@dataclass(frozen=True)
class Hull:
    """Surface voxels of the hull: ``positions`` on the smoothed surface, unit outward ``normals``; ``pitch`` is the
    side of a voxel, world units."""

    positions: Float[Tensor, "S 3"]
    normals: Float[Tensor, "S 3"]
    pitch: float


@dataclass(frozen=True)
class Mask:
    """Where one photograph shows the subject: ``inside`` is the signed distance to the silhouette in pixels, positive
    on the subject, as a function of the pixel's centre."""

    camera: Camera
    inside: Float[Tensor, "H W"]

    @staticmethod
    def from_alpha(camera: Camera, alpha: Float[np.ndarray, "H W"]) -> "Mask":
        """From opacities in [0, 1]; those of the silhouette's own pixels tell where in the pixel it runs."""
        inside, outside = alpha > 1 - PARTLY, alpha < PARTLY
        if outside.all() or not outside.any():
            return Mask(camera, torch.full(alpha.shape, float(alpha.size) * (-1 if outside.all() else 1)))
        # From each pixel to the next one that is cut, and on to where the silhouette runs in that.
        to_inside, from_inside = _to_nearest(~outside, alpha), _to_nearest(~inside, alpha)
        distance = np.where(
            inside, from_inside[0] + from_inside[1], np.where(outside, to_inside[1] - to_inside[0], alpha - 0.5)
        )
        return Mask(camera, torch.from_numpy(ndimage.gaussian_filter(distance, SILHOUETTE_BLUR).astype(np.float32)))


def _to_nearest(
    target: Bool[np.ndarray, "H W"], alpha: Float[np.ndarray, "H W"]
) -> tuple[Float[np.ndarray, "H W"], Float[np.ndarray, "H W"]]:
    """Pixels to the nearest pixel of ``target``, and how far beyond that one's centre the subject reaches."""
    distances, (rows, columns) = ndimage.distance_transform_edt(~target, return_indices=True)
    return distances, alpha[rows, columns] - 0.5


def evenly_chosen(views: Sequence[View], most: int | None = None) -> list[View]:
    """``most`` of them, by default MOST_VIEWS, or all where there are fewer."""
    count = min(len(views), MOST_VIEWS if most is None else most)
    return [views[index] for index in np.linspace(0, len(views) - 1, count).astype(int)]


def masks_of(views: Sequence[View]) -> list[Mask]:
    """The views' masks, of at most MOST_VIEWS of them, evenly chosen; none where the photographs have no mask."""
    chosen = evenly_chosen(views)
    if not all(view.has_alpha for view in chosen):
        return []
    alphas = [view.load()[..., 3].astype(np.float32) / 255 for view in counted("reading masks", chosen)]
    if sum(float((alpha <= OPAQUE).mean()) for alpha in alphas) < EMPTY_SHARE * len(alphas):
        return []
    return [Mask.from_alpha(view.camera, alpha) for view, alpha in zip(chosen, alphas, strict=True)]


def visual_hull(masks: Sequence[Mask], box: Float[Tensor, "2 3"]) -> Hull | None:
    """The hull inside ``box``, world units; None where the masks leave nothing, or there are none."""
    found = _depths_around(masks, box)
    return None if found is None else _surface(*found)


def points_within(
    masks: Sequence[Mask], box: Float[Tensor, "2 3"], count: int, drawn: torch.Generator
) -> Float[Tensor, "P 3"] | None:
    """``count`` points anywhere in the hull, evenly, world units; None where the masks leave nothing."""
    found = _depths_around(masks, box)
    if found is None:
        return None
    grid, depths = found
    solid = (depths > 0).nonzero()
    if not len(solid):
        return None
    voxels = solid[torch.randint(len(solid), (count,), generator=drawn)]
    return grid.first + grid.pitch * (voxels + torch.rand(count, 3, generator=drawn) - 0.5)


def _depths_around(
    masks: Sequence[Mask], box: Float[Tensor, "2 3"]
) -> tuple["VoxelGrid", Float[Tensor, "X Y Z"]] | None:
    """Fine voxels around the subject, and how deep in the hull each lies, up to BAND voxels."""
    if not masks:
        return None
    coarse = VoxelGrid.over(box, COARSE_CELLS)
    subject = coarse.bounds(depths_inside(coarse.centers(), masks, coarse.pitch) > -coarse.pitch)
    if subject is None:
        return None
    fine = VoxelGrid.over(subject, FINE_CELLS)
    return fine, depths_inside(fine.centers(), masks, BAND * fine.pitch).view(fine.shape)


def depths_inside(
    points: Float[Tensor, "P 3"], masks: Sequence[Mask], band: float, seen_share: float = SEEN_SHARE
) -> Float[Tensor, "P"]:
    """How deep points lie inside the hull, world units, clamped to ``band`` both ways; negative outside, and where less
    than ``seen_share`` of the views have the point inside their images.

    The least of the distances to all silhouettes, scaled by the point's depth: exact where the surface touches the
    cone of one view, which is where the hull is the subject's own surface.
    """
    alive, least, views = torch.arange(len(points)), torch.full((len(points),), band), torch.zeros(len(points))
    for mask in counted("carving the first surface", masks):
        inside, seen = _depths_by(mask, points[alive], band)
        least[alive] = torch.minimum(least[alive], inside)
        views[alive] += seen
        alive = alive[inside > -band]
    return torch.where(views >= seen_share * len(masks), least, -band).clamp_min(-band)


def has_outside(mask: Mask, points: Float[Tensor, "P 3"], outside: float) -> Bool[Tensor, "P"]:
    """Whether a mask that sees a point has it at least so far ``outside`` of the subject, world units."""
    return _depths_by(mask, points, outside)[0] <= -outside


def _depths_by(mask: Mask, points: Float[Tensor, "P 3"], band: float) -> tuple[Float[Tensor, "P"], Bool[Tensor, "P"]]:
    """How deep points lie inside one silhouette, world units, ``band`` where the image does not have them; and whether
    it does."""
    camera = mask.camera
    x, y, z = (points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]).unbind(-1)
    column = (2 / camera.width) * (camera.focal[0] * x / z + camera.center[0]) - 1
    row = (2 / camera.height) * (camera.focal[1] * y / z + camera.center[1]) - 1
    seen = (z > 0) & (column.abs() <= 1) & (row.abs() <= 1)
    pixels = torch.nn.functional.grid_sample(
        mask.inside[None, None],
        torch.stack([column, row], -1)[None, None],
        padding_mode="border",
        align_corners=False,
    )[0, 0, 0]
    return torch.where(seen, pixels * z / max(camera.focal), band), seen


@dataclass(frozen=True)
class VoxelGrid:
    """Cubic voxels: the centre of the first, the side of each, and how many along each axis."""

    first: Float[Tensor, "3"]
    pitch: float
    shape: tuple[int, int, int]

    @staticmethod
    def over(box: Float[Tensor, "2 3"], cells: int) -> "VoxelGrid":
        """``cells`` voxels along the longest side of ``box``."""
        sides = box[1] - box[0]
        pitch = float(sides.max()) / cells
        x, y, z = (max(int(np.ceil(float(side) / pitch - 1e-4)), 1) for side in sides)
        return VoxelGrid(box[0] + 0.5 * pitch, pitch, (x, y, z))

    def centers(self) -> Float[Tensor, "P 3"]:
        axes = [self.first[axis] + self.pitch * torch.arange(count) for axis, count in enumerate(self.shape)]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).view(-1, 3)

    def bounds(self, occupied: Bool[Tensor, "P"], more: int = BLURRED) -> Float[Tensor, "2 3"] | None:
        """The box of the occupied voxels and so many ``more`` on each side; None where there are none."""
        cells = occupied.view(self.shape).nonzero()
        if not len(cells):
            return None
        low, high = cells.amin(0) - (more + 0.5), cells.amax(0) + (more + 0.5)
        return self.first + self.pitch * torch.stack([low, high])


def _surface(grid: VoxelGrid, inside: Float[Tensor, "X Y Z"]) -> Hull | None:
    """Voxels inside with a neighbour outside, moved along their normal to where the blurred depth is zero."""
    depth = ndimage.gaussian_filter(inside.numpy(), SMOOTHING)
    solid = depth > 0
    border = torch.from_numpy(solid & ~ndimage.binary_erosion(solid, np.ones((3, 3, 3))))
    if not bool(border.any()):
        return None
    slope = torch.stack([torch.from_numpy(part)[border] for part in np.gradient(depth, grid.pitch)], -1)
    normals = normalize(-slope)
    outwards = torch.from_numpy(depth)[border] / slope.norm(dim=-1).clamp_min(FLATTEST_SLOPE)
    centers = grid.first + grid.pitch * border.nonzero()
    return Hull(centers + outwards.clamp_max(grid.pitch)[:, None] * normals, normals, grid.pitch)
