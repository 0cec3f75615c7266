"""Octahedral feature maps of all levels by one Triton kernel, and one for the way back.

The square's seams are sewn while nodes are read: a node on an edge is the mean of those that show the same direction,
as ``sewn`` has it, so that no sewn copy is made. The reference is ``OctahedralMaps.forward`` in torch.
"""

from collections.abc import Sequence
from typing import Any

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.triton_kernels import VARYING

ROWS = 128
"""Directions a program, at one level."""


@triton.jit
def node_of(level, line, column, side, index, mask, WIDTH: tl.constexpr):
    """Features [B F] of a sewn node: the mean of the four that its edges pair it with, which inside are all itself."""
    last = side - 1
    other_column = tl.where((line == 0) | (line == last), last - column, column)
    other_line = tl.where((column == 0) | (column == last), last - line, line)
    total = tl.load(level + (line * side + column)[:, None] * WIDTH + index[None, :], mask=mask, other=0.0)
    total += tl.load(level + (line * side + other_column)[:, None] * WIDTH + index[None, :], mask=mask, other=0.0)
    total += tl.load(level + (other_line * side + column)[:, None] * WIDTH + index[None, :], mask=mask, other=0.0)
    total += tl.load(level + (other_line * side + other_column)[:, None] * WIDTH + index[None, :], mask=mask, other=0.0)
    return 0.25 * total


@triton.jit
def add_to_node(level, line, column, side, index, values, mask, WIDTH: tl.constexpr):
    """The same mean backwards; inside the square all goes to the node itself."""
    last = side - 1
    flips = (line == 0) | (line == last)
    turns = (column == 0) | (column == last)
    other_column = tl.where(flips, last - column, column)
    other_line = tl.where(turns, last - line, line)
    edge = flips | turns
    share = tl.where(edge, 0.25, 1.0)[:, None] * values
    shared = mask & edge[:, None]
    tl.atomic_add(level + (line * side + column)[:, None] * WIDTH + index[None, :], share, mask=mask)
    tl.atomic_add(level + (line * side + other_column)[:, None] * WIDTH + index[None, :], share, mask=shared)
    tl.atomic_add(level + (other_line * side + column)[:, None] * WIDTH + index[None, :], share, mask=shared)
    tl.atomic_add(level + (other_line * side + other_column)[:, None] * WIDTH + index[None, :], share, mask=shared)


@triton.jit
def cell_of(coordinate, side):
    """The node at or below a coordinate in [-1, 1], and how far to the next one."""
    position = (tl.minimum(tl.maximum(coordinate, -1.0), 1.0) + 1.0) * (0.5 * (side - 1))
    cell = tl.minimum(position.to(tl.int32), side - 2)
    return cell, position - cell.to(tl.float32)


@triton.jit(do_not_specialize=VARYING)
def _read_maps(levels, sides, uv, features, count, WIDTH: tl.constexpr, PADDED: tl.constexpr, B: tl.constexpr):
    """``levels`` holds addresses of [side side F]; ``features`` is [N, L F]."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    number = tl.program_id(1)
    level = tl.load(levels + number).to(tl.pointer_type(tl.float32))
    side = tl.load(sides + number)
    index = tl.arange(0, PADDED)
    mask = (row < count)[:, None] & (index < WIDTH)[None, :]
    column, across = cell_of(tl.load(uv + row * 2, mask=row < count, other=0.0), side)
    line, down = cell_of(tl.load(uv + row * 2 + 1, mask=row < count, other=0.0), side)
    a = node_of(level, line, column, side, index, mask, WIDTH)
    b = node_of(level, line, column + 1, side, index, mask, WIDTH)
    c = node_of(level, line + 1, column, side, index, mask, WIDTH)
    d = node_of(level, line + 1, column + 1, side, index, mask, WIDTH)
    upper = a + (b - a) * across[:, None]
    lower = c + (d - c) * across[:, None]
    to = features + row[:, None] * (WIDTH * tl.num_programs(1)) + number * WIDTH + index[None, :]
    tl.store(to, upper + (lower - upper) * down[:, None], mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _read_maps_gradient(
    levels, gradients, sides, uv, upstream, grad_uv, count, WIDTH: tl.constexpr, PADDED: tl.constexpr, B: tl.constexpr
):
    """Adds to the levels at ``gradients``; ``grad_uv`` [L N 2] gets each level's share."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    number = tl.program_id(1)
    level = tl.load(levels + number).to(tl.pointer_type(tl.float32))
    into = tl.load(gradients + number).to(tl.pointer_type(tl.float32))
    side = tl.load(sides + number)
    index = tl.arange(0, PADDED)
    mask = (row < count)[:, None] & (index < WIDTH)[None, :]
    column, across = cell_of(tl.load(uv + row * 2, mask=row < count, other=0.0), side)
    line, down = cell_of(tl.load(uv + row * 2 + 1, mask=row < count, other=0.0), side)
    a = node_of(level, line, column, side, index, mask, WIDTH)
    b = node_of(level, line, column + 1, side, index, mask, WIDTH)
    c = node_of(level, line + 1, column, side, index, mask, WIDTH)
    d = node_of(level, line + 1, column + 1, side, index, mask, WIDTH)
    at = upstream + row[:, None] * (WIDTH * tl.num_programs(1)) + number * WIDTH + index[None, :]
    gradient = tl.load(at, mask=mask, other=0.0)
    x, y = across[:, None], down[:, None]
    by_across = tl.sum(gradient * ((b - a) * (1 - y) + (d - c) * y), 1)
    by_down = tl.sum(gradient * ((c - a) * (1 - x) + (d - b) * x), 1)
    scale = 0.5 * (side - 1)
    place = grad_uv + (number * count + row) * 2
    tl.store(place, by_across * scale, mask=row < count)
    tl.store(place + 1, by_down * scale, mask=row < count)
    add_to_node(into, line, column, side, index, gradient * (1 - x) * (1 - y), mask, WIDTH)
    add_to_node(into, line, column + 1, side, index, gradient * x * (1 - y), mask, WIDTH)
    add_to_node(into, line + 1, column, side, index, gradient * (1 - x) * y, mask, WIDTH)
    add_to_node(into, line + 1, column + 1, side, index, gradient * x * y, mask, WIDTH)


class _Maps(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, uv: Tensor, *levels: Tensor) -> Tensor:
        count, width = len(uv), levels[0].shape[2]
        sides = torch.tensor([len(level) for level in levels], dtype=torch.int32).to(uv.device)
        features = uv.new_empty(count, width * len(levels))
        if count:
            grid = (triton.cdiv(count, ROWS), len(levels))
            padded = triton.next_power_of_2(width)
            _read_maps[grid](_addresses(levels), sides, uv, features, count, width, padded, ROWS)
        ctx.save_for_backward(uv, sides, *levels)
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, ...]:
        uv, sides, *levels = ctx.saved_tensors
        count, width = len(uv), levels[0].shape[2]
        gradients = [torch.zeros_like(level) for level in levels]
        grad_uv = uv.new_zeros(len(levels), count, 2)
        if count:
            grid = (triton.cdiv(count, ROWS), len(levels))
            _read_maps_gradient[grid](
                _addresses(levels), _addresses(gradients), sides, uv, upstream.contiguous(), grad_uv, count,
                width, triton.next_power_of_2(width), ROWS,
            )  # fmt: skip
        return grad_uv.sum(0), *gradients


def _addresses(tensors: Sequence[Tensor]) -> Tensor:
    table = torch.tensor([tensor.data_ptr() for tensor in tensors], dtype=torch.int64)
    return table.to(tensors[0].device)


def maps_by_triton(uv: Float[Tensor, "N 2"], levels: Sequence[Float[Tensor, "_ _ F"]]) -> Float[Tensor, "N D"]:
    """Features at (u, v) in [-1, 1]^2, first those of the first level; differentiable in both.

    Gradients of the maps are summed in no fixed order.
    """
    features: Tensor = _Maps.apply(uv.contiguous(), *(level.contiguous() for level in levels))
    return features
