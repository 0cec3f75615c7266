"""Real spherical harmonics to degree 3, with the order and signs that 3DGS wrote into its PLY files.

Within a degree the order m runs from -l to l; odd m carry the Condon-Shortley sign, hence -y, z, -x at degree 1
(Green 2003, "Spherical Harmonic Lighting: The Gritty Details", appendix A1).

Its constants are numbers, which CMake writes into the kernels' convention.hpp.
"""

from math import pi, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

MAX_DEGREE = 3

C0 = sqrt(1 / (4 * pi))
"""The constant harmonic, 0.2820948."""

C1 = sqrt(3 / (4 * pi))
"""All of degree 1, 0.4886025."""

# Degree 2 by |m| and degree 3 by |m|: norms of the polynomials written out in sh_basis.
C2 = (sqrt(5 / (16 * pi)), sqrt(15 / (4 * pi)), sqrt(15 / (16 * pi)))
C3 = (sqrt(7 / (16 * pi)), sqrt(21 / (32 * pi)), sqrt(105 / (16 * pi)), sqrt(35 / (32 * pi)))

# A colour is stored as its distance from mid grey: all coefficients zero mean 0.5.
GREY = 0.5


def basis_count(degree: int) -> int:
    """Number of harmonics up to and including ``degree``."""
    return (degree + 1) ** 2


def sh_basis(directions: Float[Tensor, "N 3"], degree: int) -> Float[Tensor, "N K"]:
    """The K = (degree + 1)² harmonics at unit directions; degree 0 to 3. The zero vector gives only the constant."""
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    # Written as homogeneous polynomials, whose gradient along the direction drops out once it is normalized.
    by_degree = (
        lambda: [torch.full_like(x, C0)],
        lambda: [-C1 * y, C1 * z, -C1 * x],
        lambda: [
            C2[1] * x * y,
            -C2[1] * y * z,
            C2[0] * (2 * zz - xx - yy),
            -C2[1] * x * z,
            C2[2] * (xx - yy),
        ],
        lambda: [
            -C3[3] * y * (3 * xx - yy),
            2 * C3[2] * x * y * z,
            -C3[1] * y * (4 * zz - xx - yy),
            C3[0] * z * (2 * zz - 3 * xx - 3 * yy),
            -C3[1] * x * (4 * zz - xx - yy),
            C3[2] * z * (xx - yy),
            -C3[3] * x * (xx - 3 * yy),
        ],
    )
    return torch.stack([harmonic for terms in by_degree[: degree + 1] for harmonic in terms()], -1)


def sh_from_rgb(rgb: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
    """The constant coefficient that shows this colour, sRGB in [0, 1], from every side."""
    return (rgb - GREY) / C0


def rgb_from_sh(dc: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
    """Inverse of :func:`sh_from_rgb`; not clamped."""
    return GREY + C0 * dc
