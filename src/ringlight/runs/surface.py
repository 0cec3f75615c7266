"""The surface of a volume: where density passes a level, as triangles, or their corners alone."""

import math
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.memory import machine_memory
from ringlight.core.words import MEGABYTE
from ringlight.errors import BackendError, OutputError
from ringlight.models.contract import Solid

AT_ONCE = 1 << 16
"""Places whose density or colour is asked together."""


BYTES_OF_NODE = 4
"""Its density; marching cubes look at it where it lies."""

SHARE = 0.5
"""Of the machine's memory that nodes may take."""


@dataclass(frozen=True)
class Surface:
    """Corners, world units, with unit normals out of the subject and colours in [0, 1], and triangles of them, whose
    corners run counter-clockwise seen from outside."""

    corners: Float[Tensor, "V 3"]
    normals: Float[Tensor, "V 3"]
    colors: Float[Tensor, "V 3"]
    triangles: Int[Tensor, "T 3"]


def surface_of(solid: Solid, where: str) -> Surface:
    """By marching cubes (Lorensen and Cline 1987, in the form of Lewiner et al. 2003) on the nodes of its grid. Colours
    are those that are seen from straight above.

    Raises OutputError, with ``where`` in it, where density passes the level nowhere, or memory cannot hold it at all
    nodes; BackendError without the extra.
    """
    measure = _scikit_image()
    density, level = _density_of_nodes(solid, where), solid.surface_density
    if not density.min() < level < density.max():
        raise OutputError(f"{where}: cannot be written: the volume is nowhere dense enough for a surface; train longer")
    found, triangles, _, _ = measure.marching_cubes(density.numpy(), level, gradient_direction="ascent")
    corners = torch.from_numpy(found.astype(np.float32)) / torch.tensor(solid.intervals)
    low, high = solid.box.cpu()
    world = low + corners * (high - low)
    faces = torch.from_numpy(triangles.astype(np.int64))
    normals = _normals(world, faces)
    with torch.no_grad():
        parts = zip(corners.split(AT_ONCE), normals.split(AT_ONCE), strict=True)
        colors = torch.cat([solid.color(at, -above) for at, above in parts])
    return Surface(world, normals, colors, faces)


@torch.no_grad()
def _density_of_nodes(solid: Solid, where: str) -> Float[Tensor, "X Y Z"]:
    """Plane by plane: places of all nodes would be three times as large. Raises OutputError where it is too large."""
    x, y, z = sides = solid.nodes
    size, memory = math.prod(sides) * BYTES_OF_NODE, machine_memory()
    if size > SHARE * memory:
        raise OutputError(
            f"{where}: cannot be written: density at {x} x {y} x {z} nodes takes {size / MEGABYTE:,.0f} MB, and "
            f"{SHARE:.0%} of this machine's memory is {SHARE * memory / MEGABYTE:,.0f} MB; train with a coarser grid, "
            "or export on a larger machine"
        )
    of_x, of_y, of_z = (torch.arange(n) / count for n, count in zip(sides, solid.intervals, strict=True))
    plane = torch.stack(torch.meshgrid(of_x[:1], of_y, of_z, indexing="ij"), -1).view(-1, 3)
    density = torch.empty(x, y * z)
    for k in range(x):
        plane[:, 0] = of_x[k]
        parts = zip(density[k].split(AT_ONCE), plane.split(AT_ONCE), strict=True)
        for found, places in parts:
            found.copy_(solid.density_values(places))
    return density.view(sides)


def _normals(corners: Float[Tensor, "V 3"], triangles: Int[Tensor, "T 3"]) -> Float[Tensor, "V 3"]:
    """Of the triangles around each corner, by their areas."""
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    areas = torch.linalg.cross(b - a, c - a)
    total = torch.zeros_like(corners)
    for k in range(3):
        total.index_add_(0, triangles[:, k], areas)
    return torch.nn.functional.normalize(total, dim=-1)


def _scikit_image() -> ModuleType:
    """Its module of measures. Raises BackendError where the extra is not installed."""
    try:
        from skimage import measure
    except ImportError as error:
        raise BackendError('surfaces need the mesh extra: pip install "ringlight[mesh]"') from error
    module: ModuleType = measure
    return module
