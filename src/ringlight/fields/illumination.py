"""The illumination field of 3iGS (Tang and Cham 2024, section 3.2): planes times lines, mixed by a matrix."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.fields.networks import fan_in_uniform
from ringlight.fields.plane_products import PAIRS, plane_products

FIRST_DEVIATION = 0.01
"""Standard deviation of planes and lines at the start, as in 3iGS."""


class Illumination(nn.Module):
    """Features [N C] of points in [-1, 1]^3.

    ``planes`` [3 S S M] and ``lines`` [3 S M] hold M components a pair; ``mix`` [C 3M] and ``offset`` [C] mix them.
    """

    def __init__(self, side: int, components: int, features: int, generator: torch.Generator):
        super().__init__()
        joined = len(PAIRS) * components

        def noise(*shape: int) -> nn.Parameter:
            return nn.Parameter(torch.empty(shape).normal_(0, FIRST_DEVIATION, generator=generator))

        self.planes, self.lines = noise(len(PAIRS), side, side, components), noise(len(PAIRS), side, components)
        self.mix = fan_in_uniform((features, joined), joined, generator)
        self.offset = fan_in_uniform((features,), joined, generator)

    def forward(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        """In any precision; the colour model's kernel computes the same."""
        products = plane_products(points, self.planes.unbind(), self.lines.unbind())
        return torch.addmm(self.offset, products, self.mix.T)
