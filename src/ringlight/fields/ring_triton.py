"""The tabulated ring as Triton kernels: the product of four interpolated matrices, and its gradient to the tables.

    P = X Y Z V,    X = H_x(x), ... , R x R each

X and Y meet first, one column and row at a time, straight from the tables; then the columns of Z and the rows of V. So
no matrix but one is held whole, and nothing is kept for the backward pass, which begins anew. The channel core is a
product of two large matrices and stays torch's. The reference is ``ring_features``.
"""

from typing import Any

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.triton_kernels import VARYING

ROWS = 16
"""Gaussians a program: with rank 16 a matrix of each takes 32 registers of 128 threads."""

CHUNK = 1 << 16
"""Gaussians whose products are in memory at once: 64 MB with rank 16."""


@triton.jit
def _cells(coordinate, count):
    """The node at or below each coordinate in [-1, 1], and how far to the next one."""
    position = (tl.minimum(tl.maximum(coordinate, -1.0), 1.0) + 1.0) * (0.5 * (count - 1))
    cell = tl.minimum(position.to(tl.int32), count - 2)
    return cell, position - cell.to(tl.float32)


@triton.jit
def _on_axis(table, cell, fraction, entries, mask, SIZE):
    """Entries [B R] of the matrices between two nodes."""
    at = table + cell[:, None] * SIZE + entries[None, :]
    low = tl.load(at, mask=mask, other=0.0)
    return low + (tl.load(at + SIZE, mask=mask, other=0.0) - low) * fraction[:, None]


@triton.jit
def _on_map(table, corner, across, down, side, entries, mask, SIZE):
    """Entries [B R] of the matrices between four nodes."""
    at = table + corner[:, None] * SIZE + entries[None, :]
    below = at + side * SIZE
    upper = tl.load(at, mask=mask, other=0.0)
    upper += (tl.load(at + SIZE, mask=mask, other=0.0) - upper) * across[:, None]
    lower = tl.load(below, mask=mask, other=0.0)
    lower += (tl.load(below + SIZE, mask=mask, other=0.0) - lower) * across[:, None]
    return upper + (lower - upper) * down[:, None]


@triton.jit
def _add_on_axis(gradients, cell, fraction, entries, values, mask, SIZE):
    at = gradients + cell[:, None] * SIZE + entries[None, :]
    tl.atomic_add(at, values * (1 - fraction[:, None]), mask=mask)
    tl.atomic_add(at + SIZE, values * fraction[:, None], mask=mask)


@triton.jit
def _add_on_map(gradients, corner, across, down, side, entries, values, mask, SIZE):
    at = gradients + corner[:, None] * SIZE + entries[None, :]
    below = at + side * SIZE
    lower, upper = values * down[:, None], values * (1 - down[:, None])
    tl.atomic_add(at, upper * (1 - across[:, None]), mask=mask)
    tl.atomic_add(at + SIZE, upper * across[:, None], mask=mask)
    tl.atomic_add(below, lower * (1 - across[:, None]), mask=mask)
    tl.atomic_add(below + SIZE, lower * across[:, None], mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _ring_product(
    points, uv, axes, view, products, count, nodes, side, RANK: tl.constexpr, WIDTH: tl.constexpr, B: tl.constexpr
):
    """``products`` [N R R]; WIDTH is the rank's next power of two."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    index = tl.arange(0, WIDTH)
    SIZE: tl.constexpr = RANK * RANK
    mask = (row < count)[:, None] & (index < RANK)[None, :]
    x_cell, x_part = _cells(tl.load(points + row * 3, mask=row < count, other=0.0), nodes)
    y_cell, y_part = _cells(tl.load(points + row * 3 + 1, mask=row < count, other=0.0), nodes)
    z_cell, z_part = _cells(tl.load(points + row * 3 + 2, mask=row < count, other=0.0), nodes)
    column, across = _cells(tl.load(uv + row * 2, mask=row < count, other=0.0), side)
    line, down = _cells(tl.load(uv + row * 2 + 1, mask=row < count, other=0.0), side)
    corner = line * side + column
    table = nodes * SIZE
    first = tl.zeros((B, WIDTH, WIDTH), tl.float32)
    for k in range(RANK):
        x = _on_axis(axes, x_cell, x_part, index * RANK + k, mask, SIZE)
        y = _on_axis(axes + table, y_cell, y_part, k * RANK + index, mask, SIZE)
        first += x[:, :, None] * y[:, None, :]
    product = tl.zeros((B, WIDTH, WIDTH), tl.float32)
    for k in range(RANK):
        z = _on_axis(axes + 2 * table, z_cell, z_part, index * RANK + k, mask, SIZE)
        v = _on_map(view, corner, across, down, side, k * RANK + index, mask, SIZE)
        product += tl.sum(first * z[:, None, :], 2)[:, :, None] * v[:, None, :]
    entries = row[:, None, None] * SIZE + index[None, :, None] * RANK + index[None, None, :]
    tl.store(products + entries, product, mask=mask[:, :, None] & (index < RANK)[None, None, :])


@triton.jit(do_not_specialize=VARYING)
def _ring_product_gradient(
    points, uv, axes, view, upstream, grad_axes, grad_view, count, nodes, side,
    RANK: tl.constexpr, WIDTH: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Adds to ``grad_axes`` and ``grad_view``; ``upstream`` [N R R]."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    index = tl.arange(0, WIDTH)
    SIZE: tl.constexpr = RANK * RANK
    mask = (row < count)[:, None] & (index < RANK)[None, :]
    x_cell, x_part = _cells(tl.load(points + row * 3, mask=row < count, other=0.0), nodes)
    y_cell, y_part = _cells(tl.load(points + row * 3 + 1, mask=row < count, other=0.0), nodes)
    z_cell, z_part = _cells(tl.load(points + row * 3 + 2, mask=row < count, other=0.0), nodes)
    column, across = _cells(tl.load(uv + row * 2, mask=row < count, other=0.0), side)
    line, down = _cells(tl.load(uv + row * 2 + 1, mask=row < count, other=0.0), side)
    corner = line * side + column
    table = nodes * SIZE
    entries = row[:, None, None] * SIZE + index[None, :, None] * RANK + index[None, None, :]
    grad_product = tl.load(upstream + entries, mask=mask[:, :, None] & (index < RANK)[None, None, :], other=0.0)
    first = tl.zeros((B, WIDTH, WIDTH), tl.float32)
    for k in range(RANK):
        x = _on_axis(axes, x_cell, x_part, index * RANK + k, mask, SIZE)
        y = _on_axis(axes + table, y_cell, y_part, k * RANK + index, mask, SIZE)
        first += x[:, :, None] * y[:, None, :]
    by_first = tl.zeros((B, WIDTH, WIDTH), tl.float32)
    for k in range(RANK):
        z = _on_axis(axes + 2 * table, z_cell, z_part, index * RANK + k, mask, SIZE)
        v = _on_map(view, corner, across, down, side, k * RANK + index, mask, SIZE)
        seen = tl.sum(first * z[:, None, :], 2)
        by_v = tl.sum(seen[:, :, None] * grad_product, 1)
        _add_on_map(grad_view, corner, across, down, side, k * RANK + index, by_v, mask, SIZE)
        by_seen = tl.sum(grad_product * v[:, None, :], 2)
        grad_z = tl.sum(first * by_seen[:, :, None], 1)
        _add_on_axis(grad_axes + 2 * table, z_cell, z_part, index * RANK + k, grad_z, mask, SIZE)
        by_first += by_seen[:, :, None] * z[:, None, :]
    for k in range(RANK):
        x = _on_axis(axes, x_cell, x_part, index * RANK + k, mask, SIZE)
        y = _on_axis(axes + table, y_cell, y_part, k * RANK + index, mask, SIZE)
        grad_x = tl.sum(by_first * y[:, None, :], 2)
        grad_y = tl.sum(by_first * x[:, :, None], 1)
        _add_on_axis(grad_axes, x_cell, x_part, index * RANK + k, grad_x, mask, SIZE)
        _add_on_axis(grad_axes + table, y_cell, y_part, k * RANK + index, grad_y, mask, SIZE)


class _RingFeatures(torch.autograd.Function):
    """Chunk by chunk; products are made again on the way back, so that none is kept."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, uv: Tensor, axes: Tensor, view: Tensor, core: Tensor) -> Tensor:
        ctx.save_for_backward(points, uv, axes, view, core)
        chunks = zip(points.split(CHUNK), uv.split(CHUNK), strict=True)
        features = [_products(p, directions, axes, view) @ core.T for p, directions in chunks]
        return torch.cat(features) if len(features) > 1 else features[0]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_features: Tensor) -> tuple[Tensor | None, ...]:
        points, uv, axes, view, core = ctx.saved_tensors
        grad_axes, grad_view, grad_core = torch.zeros_like(axes), torch.zeros_like(view), torch.zeros_like(core)
        for p, directions, upstream in zip(
            points.split(CHUNK), uv.split(CHUNK), grad_features.split(CHUNK), strict=True
        ):
            grad_core.addmm_(upstream.T, _products(p, directions, axes, view))
            if len(p):
                _ring_product_gradient[(triton.cdiv(len(p), ROWS),)](
                    p, directions, axes, view, upstream @ core, grad_axes, grad_view, len(p), *_sizes(axes, view)
                )
        return None, None, grad_axes, grad_view, grad_core


def _products(points: Tensor, uv: Tensor, axes: Tensor, view: Tensor) -> Float[Tensor, "n D"]:
    products = axes.new_empty(len(points), axes.shape[2])
    if len(points):
        _ring_product[(triton.cdiv(len(points), ROWS),)](
            points, uv, axes, view, products, len(points), *_sizes(axes, view)
        )
    return products


def _sizes(axes: Tensor, view: Tensor) -> tuple[int, ...]:
    """Nodes of an axis and of a side of the map, rank, its next power of two, and rows a program."""
    rank = round(axes.shape[2] ** 0.5)
    return axes.shape[1], round(len(view) ** 0.5), rank, triton.next_power_of_2(rank), ROWS


def ring_features_by_triton(
    points: Float[Tensor, "N 3"],
    uv: Float[Tensor, "N 2"],
    axes: Float[Tensor, "3 K D"],
    view: Float[Tensor, "V D"],
    core: Float[Tensor, "C D"],
) -> Float[Tensor, "N C"]:
    """Features at points in [-1, 1]^3 and on the octahedral square; differentiable in the tables and the core.

    Gradients of the tables are summed in no fixed order.
    """
    tensors = (tensor.contiguous() for tensor in (points.detach(), uv.detach(), axes, view, core))
    features: Tensor = _RingFeatures.apply(*tensors)
    return features
