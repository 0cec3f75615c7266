"""Noise by which faint Gaussians look for a better place (3DGS-MCMC, equation 8)."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gaussians import Gaussians

SHARPNESS = 100.0
"""How fast the noise goes as a Gaussian gets opaque: half of it is left at the opacity at which one is dead."""

SHORTEST = 1e-12
"""Quaternions shorter than this turn nothing, as torch's normalize has it."""

STILL = 1e-4
"""Of the whole noise: a Gaussian that would get less, from an opacity of 0.1 on, gets none, and costs nothing."""


def wander_(table: Gaussians, size: float, dead: float, draw: torch.Generator) -> None:
    """Move the centres in place, by ``size`` s(100 (dead - o)) C n: o opacity, C covariance, s sigmoid, n normal.

    The covariance is R S^2 R', and R' n has the distribution of n, so that the principal axes' own n is drawn. Rows
    that are opaque stay where they are.
    """
    gate = (SHARPNESS * (dead - table.opacities)).sigmoid()
    moved = (gate > STILL).nonzero()[:, 0]
    if not len(moved) or not size:
        return
    drawn = torch.randn(len(moved), 3, generator=draw).to(table.means)
    variances = (2 * table.log_scales.index_select(0, moved)).exp_()
    along_axes = variances.mul_(drawn).mul_((size * gate.index_select(0, moved))[:, None])
    table.means.index_add_(0, moved, turned(along_axes, table.quats.index_select(0, moved)))


def turned(vectors: Float[Tensor, "N 3"], quats: Float[Tensor, "N 4"]) -> Float[Tensor, "N 3"]:
    """Each vector turned by its quaternion, wxyz, of any length."""
    # A column at a time: torch's own cross product and rotation matrices take two and four times as long.
    w, x, y, z = quats.unbind(-1)
    a, b, c = vectors.unbind(-1)
    twice = 2 / (w * w + x * x + y * y + z * z).clamp_min(SHORTEST**2)
    across_a, across_b, across_c = twice * (y * c - z * b), twice * (z * a - x * c), twice * (x * b - y * a)
    return torch.stack(
        [
            a + w * across_a + y * across_c - z * across_b,
            b + w * across_b + z * across_a - x * across_c,
            c + w * across_c + x * across_b - y * across_a,
        ],
        -1,
    )
