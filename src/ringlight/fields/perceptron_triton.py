"""Small perceptrons as Triton kernels: two or three layers without leaving the chip, nothing kept for the way back.

The backward kernel computes the hidden layers again. Each of its programs goes over many blocks of rows and adds the
weights' gradients to a slab of its own, and the slabs are summed at the end: the same bits each time. Products are in
float32, or with ``half`` of bfloat16 factors summed in float32. The reference is the ``nn.Sequential`` itself.
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

ROWS = 32
"""Rows a block."""

MOST_PROGRAMS = 256
"""Of the backward kernel; two for each processor of a large GPU, and a slab of gradients for each."""

LEAST = 16
"""Products of blocks have at least so many rows, columns and terms; narrower layers are padded with zeros."""

LAUNCH = {"num_warps": 8, "num_stages": 1}
"""One stage: weights that are the same for each block need no copies under way, and two would not fit the chip."""


@triton.jit
def _product(a, b, HALF: tl.constexpr):
    if HALF:
        result = tl.dot(a.to(tl.bfloat16), b.to(tl.bfloat16))
    else:
        result = tl.dot(a, b, input_precision="ieee")
    return result


@triton.jit
def _matrix(at, rows, columns, ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    """A weight matrix, rows first, padded with zeros."""
    mask = (rows < ROWS)[:, None] & (columns < COLUMNS)[None, :]
    return tl.load(at + rows[:, None] * COLUMNS + columns[None, :], mask=mask, other=0.0)


@triton.jit
def _add_matrix(at, rows, columns, values, ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    """To this program's slab; each thread adds to the numbers that it has written itself."""
    mask = (rows < ROWS)[:, None] & (columns < COLUMNS)[None, :]
    place = at + rows[:, None] * COLUMNS + columns[None, :]
    tl.store(place, tl.load(place, mask=mask, other=0.0) + values, mask=mask)


@triton.jit
def _add_vector(at, columns, values, COLUMNS: tl.constexpr):
    mask = columns < COLUMNS
    tl.store(at + columns, tl.load(at + columns, mask=mask, other=0.0) + values, mask=mask)


@triton.jit
def _vector(at, columns, COLUMNS: tl.constexpr):
    return tl.load(at + columns, mask=columns < COLUMNS, other=0.0)[None, :]


@triton.jit(do_not_specialize=VARYING)
def _forward(
    inputs, w1, b1, w2, b2, w3, b3, outputs, count,
    INPUTS: tl.constexpr, HIDDEN: tl.constexpr, OUTPUTS: tl.constexpr, DEEP: tl.constexpr, HALF: tl.constexpr,
    WIDE_INPUTS: tl.constexpr, WIDE_HIDDEN: tl.constexpr, WIDE_OUTPUTS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Weights as ``nn.Linear`` has them, [outputs inputs]. Without DEEP, w2 and b2 are not read."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    i, h, o = tl.arange(0, WIDE_INPUTS), tl.arange(0, WIDE_HIDDEN), tl.arange(0, WIDE_OUTPUTS)
    seen = (row < count)[:, None] & (i < INPUTS)[None, :]
    x = tl.load(inputs + row[:, None] * INPUTS + i[None, :], mask=seen, other=0.0)
    hidden = _product(x, tl.trans(_matrix(w1, h, i, HIDDEN, INPUTS)), HALF) + _vector(b1, h, HIDDEN)
    hidden = tl.maximum(hidden, 0.0)
    if DEEP:
        hidden = _product(hidden, tl.trans(_matrix(w2, h, h, HIDDEN, HIDDEN)), HALF) + _vector(b2, h, HIDDEN)
        hidden = tl.maximum(hidden, 0.0)
    y = _product(hidden, tl.trans(_matrix(w3, o, h, OUTPUTS, HIDDEN)), HALF) + _vector(b3, o, OUTPUTS)
    shown = (row < count)[:, None] & (o < OUTPUTS)[None, :]
    tl.store(outputs + row[:, None] * OUTPUTS + o[None, :], y, mask=shown)


@triton.jit(do_not_specialize=VARYING)
def _backward(
    inputs, w1, b1, w2, b2, w3, upstream, grad_inputs, slabs, count, slab,
    INPUTS: tl.constexpr, HIDDEN: tl.constexpr, OUTPUTS: tl.constexpr, DEEP: tl.constexpr, HALF: tl.constexpr,
    WIDE_INPUTS: tl.constexpr, WIDE_HIDDEN: tl.constexpr, WIDE_OUTPUTS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """``slabs`` [programs slab]: w1, b1, then w2, b2 if DEEP, then w3, b3, of each program."""
    i, h, o = tl.arange(0, WIDE_INPUTS), tl.arange(0, WIDE_HIDDEN), tl.arange(0, WIDE_OUTPUTS)
    into = slabs + tl.program_id(0) * slab
    middle = into + HIDDEN * INPUTS + HIDDEN
    end = middle
    if DEEP:
        end = middle + HIDDEN * HIDDEN + HIDDEN
    for begin in range(tl.program_id(0) * B, count, tl.num_programs(0) * B):
        row = begin + tl.arange(0, B)
        seen = (row < count)[:, None] & (i < INPUTS)[None, :]
        shown = (row < count)[:, None] & (o < OUTPUTS)[None, :]
        x = tl.load(inputs + row[:, None] * INPUTS + i[None, :], mask=seen, other=0.0)
        grad_y = tl.load(upstream + row[:, None] * OUTPUTS + o[None, :], mask=shown, other=0.0)
        first = _product(x, tl.trans(_matrix(w1, h, i, HIDDEN, INPUTS)), HALF) + _vector(b1, h, HIDDEN)
        first = tl.maximum(first, 0.0)
        last = first
        if DEEP:
            last = _product(first, tl.trans(_matrix(w2, h, h, HIDDEN, HIDDEN)), HALF) + _vector(b2, h, HIDDEN)
            last = tl.maximum(last, 0.0)
        _add_matrix(end, o, h, _product(tl.trans(grad_y), last, HALF), OUTPUTS, HIDDEN)
        _add_vector(end + OUTPUTS * HIDDEN, o, tl.sum(grad_y, 0), OUTPUTS)
        by_hidden = _product(grad_y, _matrix(w3, o, h, OUTPUTS, HIDDEN), HALF)
        by_hidden = tl.where(last > 0, by_hidden, 0.0)
        if DEEP:
            _add_matrix(middle, h, h, _product(tl.trans(by_hidden), first, HALF), HIDDEN, HIDDEN)
            _add_vector(middle + HIDDEN * HIDDEN, h, tl.sum(by_hidden, 0), HIDDEN)
            by_hidden = _product(by_hidden, _matrix(w2, h, h, HIDDEN, HIDDEN), HALF)
            by_hidden = tl.where(first > 0, by_hidden, 0.0)
        _add_matrix(into, h, i, _product(tl.trans(by_hidden), x, HALF), HIDDEN, INPUTS)
        _add_vector(into + HIDDEN * INPUTS, h, tl.sum(by_hidden, 0), HIDDEN)
        grad_x = _product(by_hidden, _matrix(w1, h, i, HIDDEN, INPUTS), HALF)
        tl.store(grad_inputs + row[:, None] * INPUTS + i[None, :], grad_x, mask=seen)


class _Perceptron(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, half: bool, inputs: Tensor, *parameters: Tensor) -> Tensor:
        ctx.half = half
        ctx.save_for_backward(inputs, *parameters)
        outputs = inputs.new_empty(len(inputs), len(parameters[-1]))
        if len(inputs):
            grid = (triton.cdiv(len(inputs), ROWS),)
            layers, sizes = _layers(parameters), _sizes(inputs, parameters, half)
            _forward[grid](inputs, *layers, outputs, len(inputs), *sizes, **LAUNCH)
        return outputs

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        inputs, *parameters = ctx.saved_tensors
        programs = max(min(triton.cdiv(len(inputs), ROWS), MOST_PROGRAMS), 1)
        slab = sum(parameter.numel() for parameter in parameters)
        slabs, grad_inputs = inputs.new_zeros(programs, slab), torch.empty_like(inputs)
        if len(inputs):
            _backward[(programs,)](
                inputs, *_layers(parameters)[:-1], upstream.contiguous(), grad_inputs, slabs, len(inputs), slab,
                *_sizes(inputs, parameters, ctx.half), **LAUNCH,
            )  # fmt: skip
        flat = slabs.sum(0).split([parameter.numel() for parameter in parameters])
        gradients = (part.view_as(parameter) for part, parameter in zip(flat, parameters, strict=True))
        return None, grad_inputs, *gradients


def _layers(parameters: Sequence[Tensor]) -> list[Tensor]:
    """Three layers; the middle one of two is the first once more, which nobody reads."""
    first, last = list(parameters[:2]), list(parameters[-2:])
    return [*first, *(parameters[2:4] if len(parameters) == 6 else first), *last]


def _sizes(inputs: Tensor, parameters: Sequence[Tensor], half: bool) -> tuple[int | bool, ...]:
    exact = (inputs.shape[1], len(parameters[0]), len(parameters[-1]))
    wide = (max(triton.next_power_of_2(width), LEAST) for width in exact)
    return *exact, len(parameters) == 6, half, *wide, ROWS


def perceptron_by_triton(
    inputs: Float[Tensor, "N I"], parameters: Sequence[Tensor], half: bool = False
) -> Float[Tensor, "N O"]:
    """Layers of one hidden width, ReLU in between; ``parameters``: weight and bias of each of two or three layers."""
    outputs: Tensor = _Perceptron.apply(half, inputs.contiguous(), *(tensor.contiguous() for tensor in parameters))
    return outputs
