"""The table to start from: one Gaussian a point."""

import math

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from ringlight.color.contract import ColorModel
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.core.words import counted
from ringlight.errors import SceneError

NEIGHBOURS = 3
"""3DGS, section 5.1: a Gaussian starts as wide as the distance to its three nearest neighbours."""

SMALLEST_SQUARED_DISTANCE = 1e-7
"""Coincident points would start with zero size."""

INITIAL_OPACITY = 0.1

OPPOSITE = 1e-8
"""Squared length below which the half-way quaternion of two opposite directions has lost its own."""

THINNESS = 0.3
"""Thickness over width of a Gaussian on a surface whose normal is known."""


def gaussians_from_points(points: PointCloud, color: ColorModel, opacity: float = INITIAL_OPACITY) -> Gaussians:
    """Gaussians at the points, with the columns that the colour model asks for.

    Round ones, or where the points have normals discs that lie in the surface, the third axis along the normal.

    Raises SceneError when there are no more points than neighbours, since then no size can be found.
    """
    count = len(points.positions)
    if count <= NEIGHBOURS:
        raise SceneError(
            f"only {counted(count, 'point')} to start from; ask for random ones with --initial-points 50000"
        )
    distances, _ = cKDTree(points.positions.numpy()).query(points.positions.numpy(), k=NEIGHBOURS + 1)
    squared = np.maximum((distances[:, 1:] ** 2).mean(1), SMALLEST_SQUARED_DISTANCE)
    log_scales = torch.from_numpy(0.5 * np.log(squared)).float()[:, None].repeat(1, 3)
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1)
    if points.normals is not None:
        log_scales[:, 2] += math.log(THINNESS)
        quats = quats_to(points.normals)
    return Gaussians(
        means=points.positions.clone().contiguous(),
        log_scales=log_scales,
        quats=quats,
        opacity_logits=torch.full((count,), math.log(opacity / (1 - opacity))),
        appearance=color.new_columns(points),
    )


def quats_to(normals: Float[Tensor, "P 3"]) -> Float[Tensor, "P 4"]:
    """Unit quaternions, wxyz, of the shortest rotations that turn the z axis to unit ``normals``."""
    x, y, z = normals.unbind(-1)
    quats = torch.stack([1 + z, -y, x, torch.zeros_like(z)], -1)
    opposite = quats.square().sum(-1) < OPPOSITE
    quats[opposite] = quats.new_tensor([0.0, 1.0, 0.0, 0.0])  # half a turn about x; every axis across z would do
    return quats / quats.norm(dim=-1, keepdim=True)
