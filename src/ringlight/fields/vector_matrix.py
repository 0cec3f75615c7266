"""The vector-matrix field (TensoRF, Chen et al. 2022, section 3; as a light field in 3iGS, Tang and Cham 2024).

    a = B concat_k(P_k(p) * l_k(p)) * d(v),   k over (xy, z), (xz, y), (yz, x)

A grid of three dimensions as sums of planes times lines, linear in between. TensoRF and 3iGS give the direction to the
network that follows; here, where the field itself depends on it, a map of directions weighs the components.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.directions import octahedral_from_directions
from ringlight.core.want import Want
from ringlight.fields.networks import fan_in_uniform
from ringlight.fields.octahedral import sewn
from ringlight.fields.plane_products import PAIRS, plane_products
from ringlight.fields.ring_settings import VectorMatrixSettings
from ringlight.fields.tables import between_map_nodes

FIRST_DEVIATION = 0.1
"""Standard deviation of planes, lines and directions at the start (TensoRF)."""


class VectorMatrix(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``. M components for each of three
    pairs.

    ``planes`` [3 S S M], row j for the plane's second axis; ``lines`` [3 S M]; ``view`` [V V 3M], one at the start but
    for noise, so that the field begins as one of position; ``basis`` [C 3M] mixes the components, without a bias.
    """

    def __init__(self, features: int, settings: VectorMatrixSettings, generator: torch.Generator):
        super().__init__()
        side, components, view = settings.side, settings.components, settings.view
        joined = len(PAIRS) * components

        def noise(*shape: int, mean: float = 0.0) -> nn.Parameter:
            return nn.Parameter(torch.empty(shape).normal_(mean, FIRST_DEVIATION, generator=generator))

        self.planes = noise(len(PAIRS), side, side, components)
        self.lines = noise(len(PAIRS), side, components)
        self.view = noise(view, view, joined, mean=1.0)
        self.basis = fan_in_uniform((features, joined), joined, generator)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        products = plane_products(points, self.planes.unbind(), self.lines.unbind())
        view = between_map_nodes(sewn(self.view).flatten(0, 1), octahedral_from_directions(directions))
        return (products * view) @ self.basis.T

    def tables(self, want: Want) -> None:
        """None: planes are no ring's, and :meth:`exact` reads tables already."""

    def differentiable_tables(self) -> None:
        """None likewise."""
