"""Spherical harmonics as Triton kernels: colour, and its gradient to means and coefficients, in one launch each.

The polynomials are those of ``core/sh_basis.py``; the way back differentiates them along the direction before it is
normalized. The reference is ``sh_colors_reference``.
"""

import functools
from typing import Any

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.sh_basis import C0, C1, C2, C3, GREY, basis_count
from ringlight.core.triton_kernels import VARYING

BLOCK = 256
"""Gaussians a program."""

NORMS = (C0, C1, *C2, *C3, GREY, SMALLEST_LENGTH**2)
"""What the kernels need of ``core/sh_basis.py``, in their order."""


@functools.cache
def norms_on(device: torch.device) -> Float[Tensor, "11"]:
    """Copied once: a copy in each step would wait for the GPU."""
    return torch.tensor(NORMS, device=device)


@triton.jit
def direction_to(means, from_x, from_y, from_z, row, mask, shortest):
    """Unit direction to the Gaussian, and the inverse of its length."""
    x = tl.load(means + row * 3, mask=mask, other=1.0) - from_x
    y = tl.load(means + row * 3 + 1, mask=mask, other=0.0) - from_y
    z = tl.load(means + row * 3 + 2, mask=mask, other=0.0) - from_z
    inverse = 1.0 / tl.sqrt(tl.maximum(x * x + y * y + z * z, shortest))
    return x * inverse, y * inverse, z * inverse, inverse


@triton.jit
def _linear(K: tl.constexpr, x, y, z, norms):
    zero = x * 0.0
    norm = tl.load(norms + 1)
    if K == 0:
        value, grad_x, grad_y, grad_z = -norm * y, zero, zero - norm, zero
    elif K == 1:
        value, grad_x, grad_y, grad_z = norm * z, zero, zero, zero + norm
    else:
        value, grad_x, grad_y, grad_z = -norm * x, zero - norm, zero, zero
    return value, grad_x, grad_y, grad_z


@triton.jit
def _quadratic(K: tl.constexpr, x, y, z, norms):
    zero = x * 0.0
    norm = tl.load(norms + 3)
    if K == 3:
        value, grad_x, grad_y, grad_z = norm * x * y, norm * y, norm * x, zero
    elif K == 4:
        value, grad_x, grad_y, grad_z = -norm * y * z, zero, -norm * z, -norm * y
    elif K == 5:
        norm = tl.load(norms + 2)
        value, grad_x, grad_y, grad_z = norm * (2 * z * z - x * x - y * y), -2 * norm * x, -2 * norm * y, 4 * norm * z
    elif K == 6:
        value, grad_x, grad_y, grad_z = -norm * x * z, -norm * z, zero, -norm * x
    else:
        norm = tl.load(norms + 4)
        value, grad_x, grad_y, grad_z = norm * (x * x - y * y), 2 * norm * x, -2 * norm * y, zero
    return value, grad_x, grad_y, grad_z


@triton.jit
def _cubic(K: tl.constexpr, x, y, z, norms):
    zero = x * 0.0
    tall = 4 * z * z - x * x - y * y
    apart = x * x - y * y
    if K == 8:
        norm = -tl.load(norms + 8)
        value, grad_x, grad_y, grad_z = norm * y * (3 * x * x - y * y), norm * 6 * x * y, norm * 3 * apart, zero
    elif K == 9:
        norm = 2 * tl.load(norms + 7)
        value, grad_x, grad_y, grad_z = norm * x * y * z, norm * y * z, norm * x * z, norm * x * y
    elif K == 10:
        norm = -tl.load(norms + 6)
        value, grad_x, grad_y, grad_z = norm * y * tall, -2 * norm * x * y, norm * (tall - 2 * y * y), 8 * norm * y * z
    elif K == 11:
        norm = tl.load(norms + 5)
        inner = 2 * z * z - 3 * x * x - 3 * y * y
        value, grad_x, grad_y, grad_z = (
            norm * z * inner,
            -6 * norm * x * z,
            -6 * norm * y * z,
            norm * (inner + 4 * z * z),
        )
    elif K == 12:
        norm = -tl.load(norms + 6)
        value, grad_x, grad_y, grad_z = norm * x * tall, norm * (tall - 2 * x * x), -2 * norm * x * y, 8 * norm * x * z
    elif K == 13:
        norm = tl.load(norms + 7)
        value, grad_x, grad_y, grad_z = norm * z * apart, 2 * norm * x * z, -2 * norm * y * z, norm * apart
    else:
        norm = -tl.load(norms + 8)
        value, grad_x, grad_y, grad_z = norm * x * (x * x - 3 * y * y), norm * 3 * apart, -6 * norm * x * y, zero
    return value, grad_x, grad_y, grad_z


@triton.jit
def harmonic(K: tl.constexpr, x, y, z, norms):
    """Harmonic K + 1, counted from the first of degree 1 on, and its slopes by x, y and z."""
    if K < 3:
        value, grad_x, grad_y, grad_z = _linear(K, x, y, z, norms)
    elif K < 8:
        value, grad_x, grad_y, grad_z = _quadratic(K, x, y, z, norms)
    else:
        value, grad_x, grad_y, grad_z = _cubic(K, x, y, z, norms)
    return value, grad_x, grad_y, grad_z


@triton.jit
def unclamped(colors, upstream, place, mask):
    """The upstream gradient of one channel, where the colour was not clamped at black."""
    shown = tl.load(colors + place, mask=mask, other=0.0) > 0
    return tl.where(shown, tl.load(upstream + place, mask=mask, other=0.0), 0.0)


@triton.jit(do_not_specialize=VARYING)
def _colors(
    means, dc, rest, norms, colors, count, from_x, from_y, from_z,
    USED: tl.constexpr, ALL: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """``USED`` harmonics of the ``ALL`` that ``rest`` [N ALL 3] holds."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    x, y, z, _ = direction_to(means, from_x, from_y, from_z, row, mask, tl.load(norms + 10))
    first, grey = tl.load(norms), tl.load(norms + 9)
    red = grey + first * tl.load(dc + row * 3, mask=mask, other=0.0)
    green = grey + first * tl.load(dc + row * 3 + 1, mask=mask, other=0.0)
    blue = grey + first * tl.load(dc + row * 3 + 2, mask=mask, other=0.0)
    for k in tl.static_range(USED):
        value, _, _, _ = harmonic(k, x, y, z, norms)
        at = rest + (row * ALL + k) * 3
        red += value * tl.load(at, mask=mask, other=0.0)
        green += value * tl.load(at + 1, mask=mask, other=0.0)
        blue += value * tl.load(at + 2, mask=mask, other=0.0)
    tl.store(colors + row * 3, tl.maximum(red, 0.0), mask=mask)
    tl.store(colors + row * 3 + 1, tl.maximum(green, 0.0), mask=mask)
    tl.store(colors + row * 3 + 2, tl.maximum(blue, 0.0), mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _gradient(
    means, rest, norms, colors, upstream, grad_means, grad_dc, grad_rest, count, from_x, from_y, from_z,
    USED: tl.constexpr, ALL: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """A channel that was clamped at black has no gradient; ``grad_rest`` of harmonics not in use is not written."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    x, y, z, inverse = direction_to(means, from_x, from_y, from_z, row, mask, tl.load(norms + 10))
    place = row * 3
    red = unclamped(colors, upstream, place, mask)
    green = unclamped(colors, upstream, place + 1, mask)
    blue = unclamped(colors, upstream, place + 2, mask)
    first = tl.load(norms)
    tl.store(grad_dc + place, first * red, mask=mask)
    tl.store(grad_dc + place + 1, first * green, mask=mask)
    tl.store(grad_dc + place + 2, first * blue, mask=mask)
    grad_x, grad_y, grad_z = x * 0.0, x * 0.0, x * 0.0
    for k in tl.static_range(USED):
        value, slope_x, slope_y, slope_z = harmonic(k, x, y, z, norms)
        at = (row * ALL + k) * 3
        slope = red * tl.load(rest + at, mask=mask, other=0.0)
        slope += green * tl.load(rest + at + 1, mask=mask, other=0.0)
        slope += blue * tl.load(rest + at + 2, mask=mask, other=0.0)
        grad_x += slope * slope_x
        grad_y += slope * slope_y
        grad_z += slope * slope_z
        tl.store(grad_rest + at, value * red, mask=mask)
        tl.store(grad_rest + at + 1, value * green, mask=mask)
        tl.store(grad_rest + at + 2, value * blue, mask=mask)
    along = grad_x * x + grad_y * y + grad_z * z
    tl.store(grad_means + place, (grad_x - along * x) * inverse, mask=mask)
    tl.store(grad_means + place + 1, (grad_y - along * y) * inverse, mask=mask)
    tl.store(grad_means + place + 2, (grad_z - along * z) * inverse, mask=mask)


class _Harmonics(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, means: Tensor, dc: Tensor, rest: Tensor, position: Tensor, degree: int) -> Tensor:
        colors = torch.empty_like(means)
        ctx.position, ctx.used = position.tolist(), basis_count(degree) - 1
        ctx.save_for_backward(means, rest, colors)
        if len(means):
            grid = (triton.cdiv(len(means), BLOCK),)
            sizes = (ctx.used, rest.shape[1], BLOCK)
            _colors[grid](means, dc, rest, norms_on(means.device), colors, len(means), *ctx.position, *sizes)
        return colors

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        means, rest, colors = ctx.saved_tensors
        grad_means, grad_dc, grad_rest = torch.empty_like(means), torch.empty_like(means), torch.zeros_like(rest)
        if len(means):
            _gradient[(triton.cdiv(len(means), BLOCK),)](
                means, rest, norms_on(means.device), colors, upstream.contiguous(), grad_means, grad_dc, grad_rest,
                len(means), *ctx.position, ctx.used, rest.shape[1], BLOCK,
            )  # fmt: skip
        return grad_means, grad_dc, grad_rest, None, None


def sh_colors_by_triton(
    means: Float[Tensor, "N 3"],
    dc: Float[Tensor, "N 3"],
    rest: Float[Tensor, "N K 3"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N 3"]:
    """Colour towards a camera at ``position``, clamped at black; differentiable in means and coefficients.

    Raises ValueError where ``rest`` does not hold all harmonics of the degree: the kernels would read the next row.
    """
    if rest.shape[1] < basis_count(degree) - 1:
        raise ValueError(f"rest holds {rest.shape[1]} harmonics, and degree {degree} has {basis_count(degree) - 1}")
    colors: Tensor = _Harmonics.apply(means.contiguous(), dc.contiguous(), rest.contiguous(), position, degree)
    return colors
