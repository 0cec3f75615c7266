"""Buffers as pictures: depth, normals, signed differences and scalars, each [H W c] to [H W 3] in [0, 1]."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

LOW, HIGH = 0.02, 0.98
"""Quantiles that become the ends of the depth scale, so that a few floaters do not flatten the picture."""

FARTHEST_GRAY = 0.15
"""The far end stays lighter than the empty background, which is black."""

COVERED = 0.5
"""Pixels with at least this much alpha decide the depth scale."""

MOST_SAMPLES = 1 << 20
"""torch.quantile refuses more than 16 million values; a regular subset serves."""


def depth_picture(
    depth: Float[Tensor, "H W 1"], alpha: Float[Tensor, "H W 1"], near_far: tuple[float, float]
) -> Float[Tensor, "H W 3"]:
    """Depth of the surface (camera z, world units) as gray: near white, far dark, nothing black.

    ``near_far`` is the scale, one for all pictures of a film; see :func:`depth_range`.
    """
    near, far = near_far
    share = ((depth - near) / max(far - near, 1e-12)).clamp(0, 1)
    gray = (1 - share * (1 - FARTHEST_GRAY)) * alpha.clamp(0, 1)
    return gray_picture(gray)


def depth_range(depth: Float[Tensor, "H W 1"], alpha: Float[Tensor, "H W 1"]) -> tuple[float, float]:
    """Near and far of the covered pixels, world units, without the outer 2 percent; (0, 1) for an empty picture."""
    distances = depth[alpha >= COVERED]
    distances = distances[distances.isfinite()]
    if not len(distances):
        return (0.0, 1.0)
    distances = distances[:: len(distances) // MOST_SAMPLES + 1]
    near, far = torch.quantile(distances, torch.tensor([LOW, HIGH]).to(distances)).tolist()
    return (near, far)


def nearest_depth(depth: Float[Tensor, "H W 1"], alpha: Float[Tensor, "H W 1"]) -> float:
    """Of the pixels that are covered at least half as much as any, world units, without the nearest 2 percent; infinite
    for an empty picture. Of a model that was hardly trained no pixel may be half covered."""
    distances = depth[(alpha >= COVERED * alpha.max()) & (depth > 0)]
    distances = distances[distances.isfinite()]
    if not len(distances):
        return math.inf
    return float(torch.quantile(distances[:: len(distances) // MOST_SAMPLES + 1], LOW))


def signed_picture(values: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    """Signed colours, or directions with x red, y green and z blue, in [-1, 1] around middle gray."""
    return (0.5 + 0.5 * values).clamp(0, 1)


def gray_picture(values: Float[Tensor, "H W 1"]) -> Float[Tensor, "H W 3"]:
    """One value in [0, 1] as gray."""
    return values.clamp(0, 1).expand(-1, -1, 3)
