"""Points on the surface that the photographs show, with outward normals: where deferred models start; and in its hull.

On the visual hull where the photographs have masks, or an even background that gives some; else the scene's own points,
with normals from the planes through their neighbours, turned towards the cameras in front of them.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.randomness import generator
from ringlight.core.scene import PointCloud, Scene
from ringlight.data.border_masks import PROBES, border_masks, on_even_background
from ringlight.data.hull import Mask, evenly_chosen, masks_of, points_within, visual_hull
from ringlight.data.photographed_colors import photographed_colors

PLANE_NEIGHBOURS = 12
"""Points through which a plane is laid: fewer follow their noise, more cut corners."""


def own_points(scene: Scene) -> PointCloud:
    """The scene's own points, with normals."""
    positions = scene.points.positions
    return replace(scene.points, normals=plane_normals(positions, [view.camera for view in scene.train]))


def is_cut_out(scene: Scene) -> bool:
    """Whether photographs have masks, or an even background, by which a hull may be carved. Of those that would carve
    it a few are looked at: to decode all takes seconds."""
    carving = evenly_chosen(scene.train)
    have_masks = all(view.has_alpha for view in carving) and masks_of(evenly_chosen(carving, PROBES))
    return bool(have_masks) or on_even_background(scene.train, scene.background_color)


def hull_points(scene: Scene, count: int, seed: int) -> PointCloud | None:
    """``count`` points drawn from the visual hull; None without masks and even background. Some seconds."""
    masks = masks_of(scene.train) or guessed_masks(scene)
    return points_on_hull(masks, scene, count, seed)


def guessed_masks(scene: Scene) -> list[Mask]:
    """Masks from the photographs' even background; none where that has not the colour that the scene is drawn over."""
    return border_masks(scene.train, scene.box, scene.background_color)


def points_on_hull(masks: Sequence[Mask], scene: Scene, count: int, seed: int) -> PointCloud | None:
    """``count`` points drawn from the hull of these masks, with the photographs' colours; None where there is none."""
    hull = visual_hull(masks, scene.box)
    if hull is None:
        return None
    colors = photographed_colors(hull.positions, hull.normals, hull.pitch, scene)
    draw = generator(seed, 0, "surface points")
    rounds = [torch.randperm(len(hull.positions), generator=draw) for _ in range(-(-count // len(hull.positions)))]
    rows = torch.cat(rounds)[:count]
    normals = hull.normals[rows]
    jitter = hull.pitch * (torch.rand(count, 3, generator=draw) - 0.5)
    within = jitter - (jitter * normals).sum(-1, keepdim=True) * normals  # moved within the voxel, not off the surface
    return PointCloud(hull.positions[rows] + within, colors[rows], normals, origin="hull")


def points_in_hull(masks: Sequence[Mask], scene: Scene, count: int, seed: int) -> PointCloud | None:
    """``count`` points drawn from all that these masks leave, not from its surface alone, of random colours, since most
    are hidden; None where they leave nothing."""
    drawn = generator(seed, 0, "points in the hull")
    positions = points_within(masks, scene.box, count, drawn)
    if positions is None:
        return None
    return PointCloud(positions, torch.rand(count, 3, generator=drawn), origin="in hull")


def plane_normals(positions: Float[Tensor, "P 3"], cameras: Sequence[Camera]) -> Float[Tensor, "P 3"]:
    """Unit normals of the planes through each point's neighbours, turned to the side from which most cameras
    have it in view."""
    neighbours = min(PLANE_NEIGHBOURS, len(positions))
    _, rows = cKDTree(positions.numpy()).query(positions.numpy(), k=neighbours)
    near = positions[torch.from_numpy(rows).view(len(positions), neighbours)]
    centered = near - near.mean(1, keepdim=True)
    normals = torch.linalg.eigh(centered.transpose(1, 2) @ centered)[1][..., 0]
    votes = torch.zeros(len(positions))
    for camera in cameras:
        towards = normalize(camera.position - positions)
        votes += (towards * normals).sum(-1) * camera.pixels(positions)[2]
    return normals * torch.where(votes >= 0, 1.0, -1.0)[:, None]
