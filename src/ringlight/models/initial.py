"""The table to start from: one Gaussian a point."""

import numpy as np
import torch
from scipy.spatial import cKDTree

from ringlight.color.contract import ColorModel
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.errors import SceneError

NEIGHBOURS = 3
"""3DGS, section 5.1: a Gaussian starts as wide as the distance to its three nearest neighbours."""

SMALLEST_SQUARED_DISTANCE = 1e-7
"""Coincident points would start with zero size."""

INITIAL_OPACITY = 0.1


def gaussians_from_points(points: PointCloud, color: ColorModel) -> Gaussians:
    """Isotropic Gaussians at the points, with the columns that the colour model asks for.

    Raises SceneError when there are no more points than neighbours, since then no size can be found.
    """
    count = len(points.positions)
    if count <= NEIGHBOURS:
        raise SceneError(f"only {count} points to start from; ask for random ones with --initial-points 50000")
    distances, _ = cKDTree(points.positions.numpy()).query(points.positions.numpy(), k=NEIGHBOURS + 1)
    squared = np.maximum((distances[:, 1:] ** 2).mean(1), SMALLEST_SQUARED_DISTANCE)
    log_scales = torch.from_numpy(0.5 * np.log(squared)).float()[:, None].repeat(1, 3)
    return Gaussians(
        means=points.positions.clone().contiguous(),
        log_scales=log_scales,
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        opacity_logits=torch.full((count,), float(np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)))),
        appearance=color.new_columns(points),
    )
