"""Planes times lines: a grid of three dimensions as sums of bilinear times linear tables.

TensoRF (Chen et al. 2022, section 3), as a light field 3iGS (Tang and Cham 2024, section 3.2). Knows nothing of what
the numbers mean: densities, colours or features. Axes may have different numbers of nodes.
"""

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
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
    """Plane times line for each of the three :data:`PAIRS`, side by side, 3 C channels; without a graph.

    Points outside [-1, 1]^3 are taken to its nearest; what is not a number is at -1. By the kernel for float32 on the
    CPU.
    """
    if not _runs_native(points, planes, lines):
        return plane_products_reference(points, planes, lines).detach()
    products = points.new_empty(len(points), len(PAIRS) * planes[0].shape[-1])
    _kernels.plane_products(*_contiguous(points, planes, lines), products)
    return products


def plane_gradients(
    points: Float[Tensor, "N 3"],
    planes: Sequence[Plane],
    lines: Sequence[Line],
    upstream: Float[Tensor, "N channels"],
    into: tuple[Sequence[Plane], Sequence[Line]] | None = None,
) -> tuple[Sequence[Plane], Sequence[Line]]:
    """The way back of :func:`plane_products` by ``upstream`` [N 3C]; none for points.

    ``into`` are tensors like the grids that the gradients are written to, such as parts of one; new ones by default.
    """
    if into is None:
        into = [torch.empty_like(plane) for plane in planes], [torch.empty_like(line) for line in lines]
    of_planes, of_lines = into
    if _runs_native(points, planes, lines):
        rows = _contiguous(points, planes, lines)
        _kernels.plane_gradient(*rows, upstream.contiguous(), list(of_planes), list(of_lines))
        return into
    grids = [grid.detach().requires_grad_() for grid in (*planes, *lines)]
    with torch.enable_grad():
        products = plane_products_reference(points.detach(), grids[: len(PAIRS)], grids[len(PAIRS) :])
    found = torch.autograd.grad(products, grids, upstream)
    for place, gradient in zip((*of_planes, *of_lines), found, strict=True):
        place.copy_(gradient)
    return into


def differentiable_plane_products(
    points: Float[Tensor, "N 3"], planes: Sequence[Plane], lines: Sequence[Line]
) -> Float[Tensor, "N channels"]:
    """:func:`plane_products` within torch's graph, with gradients of planes and lines alone."""
    found: Tensor = _Products.apply(points, *planes, *lines)
    return found


def plane_products_reference(
    points: Float[Tensor, "N 3"], planes: Sequence[Plane], lines: Sequence[Line]
) -> Float[Tensor, "N channels"]:
    """What the kernel computes, in torch, in any precision, and differentiable in the points too."""
    products = [
        _between_plane_nodes(plane, points[:, first], points[:, second]) * between_nodes(line, points[:, along])
        for plane, line, ((first, second), along) in zip(planes, lines, PAIRS, strict=True)
    ]
    return torch.cat(products, -1)


def _between_plane_nodes(plane: Plane, across: Float[Tensor, "N"], down: Float[Tensor, "N"]) -> Float[Tensor, "N C"]:
    height, width = plane.shape[:2]
    (column, right), (row, below) = node_cells(across, width), node_cells(down, height)
    nodes, first = plane.flatten(0, 1), row * width + column
    above = torch.lerp(nodes[first], nodes[first + 1], right)
    return torch.lerp(above, torch.lerp(nodes[first + width], nodes[first + width + 1], right), below)


class _Products(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, *grids: Tensor) -> Tensor:
        ctx.save_for_backward(points, *grids)
        return plane_products(points, grids[: len(PAIRS)], grids[len(PAIRS) :])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        points, *grids = ctx.saved_tensors
        planes, lines = plane_gradients(points, grids[: len(PAIRS)], grids[len(PAIRS) :], upstream)
        return (None, *planes, *lines)


def _runs_native(points: Tensor, planes: Sequence[Tensor], lines: Sequence[Tensor]) -> bool:
    return all(tensor.dtype == torch.float32 and tensor.is_cpu for tensor in (points, *planes, *lines))


def _contiguous(
    points: Tensor, planes: Sequence[Tensor], lines: Sequence[Tensor]
) -> tuple[Tensor, list[Tensor], list[Tensor]]:
    return points.contiguous(), [plane.contiguous() for plane in planes], [line.contiguous() for line in lines]
