"""Planes times lines: a grid of three dimensions as sums of bilinear times linear tables.

TensoRF (Chen et al. 2022, section 3), as a light field 3iGS (Tang and Cham 2024, section 3.2). Knows nothing of what
the numbers mean: densities, colours or features. Axes may have different numbers of nodes.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.rows import rows_at
from ringlight.fields.tables import between_nodes, node_cells

PAIRS = (((0, 1), 2), ((0, 2), 1), ((1, 2), 0))
"""Axes of each plane, and of the line that goes with it."""

Plane = Float[Tensor, "_ _ _"]
"""[down across C]: rows go along the pair's second axis, columns along its first; the first and last nodes lie at -1
and 1."""
Line = Float[Tensor, "_ _"]
"""[along C]."""


def plane_products(
    points: Float[Tensor, "N 3"], planes: Sequence[Plane], lines: Sequence[Line]
) -> Float[Tensor, "N channels"]:
    """Plane times line for each of the three :data:`PAIRS`, side by side, 3 C channels; differentiable.

    Points outside [-1, 1]^3 are taken to its nearest; what is not a number is at -1. kernels/planes/ computes the same.
    """
    products = [
        _between_plane_nodes(plane, points[:, first], points[:, second]) * between_nodes(line, points[:, along])
        for plane, line, ((first, second), along) in zip(planes, lines, PAIRS, strict=True)
    ]
    return torch.cat(products, -1)


def _between_plane_nodes(plane: Plane, across: Float[Tensor, "N"], down: Float[Tensor, "N"]) -> Float[Tensor, "N C"]:
    height, width = plane.shape[:2]
    (column, right), (row, below) = node_cells(across, width), node_cells(down, height)
    nodes, first = plane.flatten(0, 1), row * width + column
    above = torch.lerp(rows_at(nodes, first), rows_at(nodes, first + 1), right)
    return torch.lerp(above, torch.lerp(rows_at(nodes, first + width), rows_at(nodes, first + width + 1), right), below)
