"""Directions on the unit sphere: from camera to point, reflected, the octahedral square, shortest axes.

Its constants are numbers, which CMake writes into the kernels' convention.hpp.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gaussians import Gaussians

SMALLEST_LENGTH = 1e-12
"""Below this length a direction is undefined; the zero vector maps to itself instead of NaN."""


def normalize(vectors: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
    """Unit vectors. Squares and rsqrt, because torch's vector norm over three columns is tens of times slower."""
    squared = (vectors * vectors).sum(-1, keepdim=True)
    return vectors * squared.clamp_min(SMALLEST_LENGTH**2).rsqrt()


def view_directions(points: Float[Tensor, "N 3"], position: Float[Tensor, "3"]) -> Float[Tensor, "N 3"]:
    """Unit directions from the camera at ``position`` to the points."""
    return normalize(points - position)


def reflect(directions: Float[Tensor, "N 3"], normals: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
    """Mirror directions that travel *towards* a surface: d - 2 (d.n) n."""
    return directions - 2 * (directions * normals).sum(-1, keepdim=True) * normals


def shortest_axes(gaussians: Gaussians, position: Float[Tensor, "3"]) -> Float[Tensor, "N 3"]:
    """Each Gaussian's shortest principal axis, turned towards the camera: the usual stand-in for a normal."""
    shortest = gaussians.log_scales.argmin(-1)
    axes = gaussians.rotations.gather(2, shortest[:, None, None].expand(-1, 3, 1))[..., 0]
    facing = ((position - gaussians.means).detach() * axes.detach()).sum(-1, keepdim=True) >= 0
    return torch.where(facing, axes, -axes)


def octahedral_from_directions(directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N 2"]:
    """Unit sphere to the square [-1, 1]^2 (Meyer et al. 2010); the lower hemisphere folds over the diagonals."""
    flat = directions / directions.abs().sum(-1, keepdim=True).clamp_min(SMALLEST_LENGTH)
    x, y, z = flat.unbind(-1)
    sign_x, sign_y = torch.where(x >= 0, 1.0, -1.0), torch.where(y >= 0, 1.0, -1.0)
    u = torch.where(z >= 0, x, (1 - y.abs()) * sign_x)
    v = torch.where(z >= 0, y, (1 - x.abs()) * sign_y)
    return torch.stack([u, v], -1)


def directions_from_octahedral(uv: Float[Tensor, "N 2"]) -> Float[Tensor, "N 3"]:
    """Inverse of :func:`octahedral_from_directions`."""
    x, y = uv.unbind(-1)
    z = 1 - x.abs() - y.abs()
    fold = (-z).clamp_min(0)
    x = x - torch.where(x >= 0, fold, -fold)
    y = y - torch.where(y >= 0, fold, -fold)
    return normalize(torch.stack([x, y, z], -1))
