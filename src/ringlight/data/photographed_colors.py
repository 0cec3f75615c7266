"""Colours of surface points from the photographs that see them: what a base colour may start from."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.scene import Scene, View
from ringlight.core.stages import counted

MOST_VIEWS = 60
"""Photographs that are averaged, evenly chosen."""

CELL = 1.5
"""Side of a cell of the depth map over the projected spacing of points: smaller ones would have holes."""

TOLERANCE = 2.5
"""Spacings behind the nearest point of a cell at which a point still counts as seen."""

STEEPEST = 0.2
"""Least cosine between normal and view: what is seen more flatly is smeared over by the silhouette."""

UNSEEN_COLOR = 0.5


def photographed_colors(
    positions: Float[Tensor, "P 3"], normals: Float[Tensor, "P 3"], spacing: float, scene: Scene
) -> Float[Tensor, "P 3"]:
    """Mean colour, sRGB in [0, 1], over the photographs in which a point is not hidden; mid grey where there is none.

    ``spacing`` is the distance between neighbouring points, world units.
    """
    views: Sequence[View] = scene.train[:: -(-len(scene.train) // MOST_VIEWS)]
    total, count = torch.zeros_like(positions), torch.zeros(len(positions), 1)
    for view in counted("colouring the first surface", views):
        pixels, seen = _seen(positions, normals, spacing, view.camera)
        picture = view.image(scene.background_color).flatten(1).T
        total[seen] += picture[pixels]
        count[seen] += 1
    return torch.where(count > 0, total / count.clamp_min(1), UNSEEN_COLOR)


def _seen(
    positions: Float[Tensor, "P 3"], normals: Float[Tensor, "P 3"], spacing: float, camera: Camera
) -> tuple[Int[Tensor, "V"], Bool[Tensor, "P"]]:
    """Which points the camera sees, and the pixel of each of those."""
    column, row, inside = camera.pixels(positions)
    z = camera.depths(positions)
    facing = (normalize(camera.position - positions) * normals).sum(-1) > STEEPEST
    if not bool(inside.any()):
        return row[inside], inside
    side = max(round(CELL * spacing * max(camera.focal) / float(z[inside].median())), 1)
    across = camera.width // side + 1
    cell = torch.where(inside, (row // side) * across + column // side, 0)
    far = torch.full((across * (camera.height // side + 1),), torch.inf)
    nearest = far.scatter_reduce(0, cell, torch.where(inside, z, torch.inf), "amin")
    seen = inside & facing & (z <= nearest[cell] + TOLERANCE * spacing)
    return (row * camera.width + column)[seen], seen
