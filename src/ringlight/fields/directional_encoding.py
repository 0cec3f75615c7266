"""Integrated directional encoding: a direction, less and less of it the rougher the surface.

Ref-NeRF (Verbin et al. 2022, section 4 and equation 8): spherical harmonics of the levels 1, 2, 4 and 8, whose mean
over directions scattered by a von Mises-Fisher distribution is nearly exp(-l (l + 1) roughness / 2) of the value in the
middle.
"""

import functools

import torch
from jaxtyping import Float
from numpy.polynomial import Legendre, Polynomial
from torch import Tensor

LEVELS = (1, 2, 4, 8)
ORDERS = tuple((level, order) for level in LEVELS for order in range(level + 1))
"""Level and order of each of the 19 harmonics."""
CODE_WIDTH = 2 * len(ORDERS)
"""Real parts of all harmonics, then imaginary parts."""


@functools.cache
def harmonic_polynomials() -> Float[Tensor, "19 9"]:
    """Coefficients of powers of z, the constant first: harmonic (l, m) is (x + iy)^m times a polynomial of z, the m-th
    derivative of Legendre's of degree l with the orthonormal harmonics' factor."""
    found = torch.zeros(len(ORDERS), max(LEVELS) + 1, dtype=torch.float64)
    for row, (level, order) in enumerate(ORDERS):
        polynomial = Legendre.basis(level).convert(kind=Polynomial).deriv(order)
        ratio = torch.tensor([level - order + 1.0, level + order + 1.0], dtype=torch.float64).lgamma().diff().neg()
        factor = ((2 * level + 1) / (4 * torch.pi) * ratio.exp()).sqrt() * (-1) ** order
        coefficients = torch.from_numpy(polynomial.coef)
        found[row, : len(coefficients)] = factor * coefficients
    return found


@functools.cache
def fading() -> Float[Tensor, "38"]:
    """By how much the logarithm of each number falls with the roughness: l (l + 1) / 2."""
    by_pair = torch.tensor([level * (level + 1) / 2 for level, _ in ORDERS])
    return torch.cat([by_pair, by_pair])


@functools.cache
def kernel_polynomials() -> Float[Tensor, "19 9"]:
    """The same as the kernels take them."""
    return harmonic_polynomials().float()


def directional_encoding(directions: Float[Tensor, "N 3"], roughness: Float[Tensor, "N"]) -> Float[Tensor, "N 38"]:
    """Codes of unit ``directions``; ``roughness`` is 0 or more, an inverse concentration.

    kernels/encoding/ computes the same.
    """
    x, y, z = directions.unbind(-1)
    powers = torch.stack([z**power for power in range(max(LEVELS) + 1)], -1)
    along = powers @ harmonic_polynomials().to(powers).T
    real, imaginary = [torch.ones_like(x)], [torch.zeros_like(x)]
    for _ in range(max(LEVELS)):
        before = real[-1], imaginary[-1]
        real.append(x * before[0] - y * before[1])
        imaginary.append(x * before[1] + y * before[0])
    orders = [order for _, order in ORDERS]
    around = torch.stack([part[order] for part in (real, imaginary) for order in orders], -1)
    return torch.cat([along, along], -1) * around * (-roughness[:, None] * fading().to(around)).exp()
