"""Rows of a table between its nodes: linear on [-1, 1], bilinear on the octahedral square.

The first and last node lie on the ends, -1 and 1. On an octahedral map the edge nodes of both halves of an edge
then stand for the same directions, so that a tabulated function is continuous over the seams.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.directions import directions_from_octahedral
from ringlight.core.rows import rows_at

MOST_SHARED = 32
"""Rows of a table that is read as a product of matrices on a GPU. So few rows are met by thousands of points each, and
gradients added to one row wait for each other: on an H100 the way back of a shaded picture of 800 pixels on a side took
72 ms with 16 rows, and 4 ms so (docs/cuda.md). Only 16 were measured; twice as many double the product."""


def axis_nodes(count: int) -> Float[Tensor, "K"]:
    """Evenly spaced coordinates from -1 to 1."""
    return torch.linspace(-1, 1, count)


def octahedral_nodes(side: int) -> Float[Tensor, "K 3"]:
    """Unit directions of a side x side map, K = side^2; node (i, j) of the square's axes is row j * side + i."""
    axis = axis_nodes(side)
    second, first = torch.meshgrid(axis, axis, indexing="ij")
    return directions_from_octahedral(torch.stack([first, second], -1).flatten(0, 1))


def node_cells(coordinates: Float[Tensor, "N"], count: int) -> tuple[Int[Tensor, "N"], Float[Tensor, "N 1"]]:
    """The node at or below each coordinate, and how far to the next one, in [0, 1]. NaN is -1, as in the kernels."""
    position = (coordinates.nan_to_num(nan=-1.0).clamp(-1, 1) + 1) * (0.5 * (count - 1))
    cell = position.detach().long().clamp(max=count - 2)
    return cell, (position - cell)[:, None]


def between_nodes(table: Float[Tensor, "K D"], coordinates: Float[Tensor, "N"]) -> Float[Tensor, "N D"]:
    """Linear interpolation at coordinates in [-1, 1]; outside, the end rows."""
    if table.is_cuda and len(table) <= MOST_SHARED:
        return shares_of_nodes(coordinates, len(table)) @ table
    cell, fraction = node_cells(coordinates, len(table))
    return torch.lerp(rows_at(table, cell), rows_at(table, cell + 1), fraction)


def shares_of_nodes(coordinates: Float[Tensor, "N"], count: int) -> Float[Tensor, "N K"]:
    """What each node counts in a linear interpolation; one or two are not zero."""
    cell, fraction = node_cells(coordinates, count)
    steps = torch.arange(count, device=cell.device) - cell[:, None]
    return torch.where(steps == 0, 1 - fraction, torch.where(steps == 1, fraction, 0))


def between_map_nodes(table: Float[Tensor, "K D"], uv: Float[Tensor, "N 2"]) -> Float[Tensor, "N D"]:
    """Bilinear interpolation on a square map with K = side^2 rows, at (u, v) in [-1, 1]^2."""
    side = round(len(table) ** 0.5)
    column, across = node_cells(uv[:, 0], side)
    row, down = node_cells(uv[:, 1], side)
    corner = row * side + column
    upper = torch.lerp(rows_at(table, corner), rows_at(table, corner + 1), across)
    lower = torch.lerp(rows_at(table, corner + side), rows_at(table, corner + side + 1), across)
    return torch.lerp(upper, lower, down)
