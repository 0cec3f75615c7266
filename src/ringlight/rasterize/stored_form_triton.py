"""The active form of the table by one Triton kernel, and one for the way back; beside ``active_form_reference``."""

from typing import Any

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.triton_kernels import VARYING

BLOCK = 512
"""Gaussians a program."""


@triton.jit
def _is_fine(means, log_scales, row, mask, plane, near, log_reach, farthest):
    """Whether a row can be projected in float32; ``plane`` gives the camera's z."""
    x = tl.load(means + row * 3, mask=mask, other=0.0)
    y = tl.load(means + row * 3 + 1, mask=mask, other=0.0)
    z = tl.load(means + row * 3 + 2, mask=mask, other=0.0)
    depth = x * tl.load(plane) + y * tl.load(plane + 1) + z * tl.load(plane + 2) + tl.load(plane + 3)
    a = tl.load(log_scales + row * 3, mask=mask, other=0.0)
    b = tl.load(log_scales + row * 3 + 1, mask=mask, other=0.0)
    c = tl.load(log_scales + row * 3 + 2, mask=mask, other=0.0)
    widest = log_reach + tl.log(tl.where(depth > near, depth, near))
    farther = tl.maximum(tl.maximum(tl.abs(x), tl.abs(y)), tl.abs(z))
    return (tl.maximum(tl.maximum(a, b), c) < widest) & (farther < farthest) & (depth - depth == 0)


@triton.jit(do_not_specialize=VARYING)
def _activate(
    means, log_scales, quats, logits, factor, plane, active_quats, scales, opacities,
    count, near, log_reach, farthest, shortest, FACTOR: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    fine = _is_fine(means, log_scales, row, mask, plane, near, log_reach, farthest)
    for axis in tl.static_range(3):
        value = tl.load(log_scales + row * 3 + axis, mask=mask, other=0.0)
        tl.store(scales + row * 3 + axis, tl.exp(tl.where(fine, value, 0.0)), mask=mask)
    squared = tl.zeros((B,), tl.float32)
    for part in tl.static_range(4):
        value = tl.load(quats + row * 4 + part, mask=mask, other=0.0)
        squared += value * value
    turns = squared > shortest
    for part in tl.static_range(4):
        value = tl.load(quats + row * 4 + part, mask=mask, other=0.0)
        tl.store(active_quats + row * 4 + part, tl.where(turns, value, 1.0 if part == 0 else 0.0), mask=mask)
    opacity = tl.sigmoid(tl.load(logits + row, mask=mask, other=0.0))
    if FACTOR:
        opacity *= tl.load(factor + row, mask=mask, other=0.0)
    tl.store(opacities + row, tl.where(fine, opacity, 0.0), mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _activate_gradient(
    means, log_scales, quats, logits, factor, plane, grad_quats, grad_scales, grad_opacities,
    to_log_scales, to_quats, to_logits, to_factor,
    count, near, log_reach, farthest, shortest, FACTOR: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    fine = _is_fine(means, log_scales, row, mask, plane, near, log_reach, farthest)
    for axis in tl.static_range(3):
        value = tl.exp(tl.where(fine, tl.load(log_scales + row * 3 + axis, mask=mask, other=0.0), 0.0))
        upstream = tl.load(grad_scales + row * 3 + axis, mask=mask, other=0.0)
        tl.store(to_log_scales + row * 3 + axis, tl.where(fine, upstream * value, 0.0), mask=mask)
    squared = tl.zeros((B,), tl.float32)
    for part in tl.static_range(4):
        value = tl.load(quats + row * 4 + part, mask=mask, other=0.0)
        squared += value * value
    for part in tl.static_range(4):
        upstream = tl.load(grad_quats + row * 4 + part, mask=mask, other=0.0)
        tl.store(to_quats + row * 4 + part, tl.where(squared > shortest, upstream, 0.0), mask=mask)
    opacity = tl.sigmoid(tl.load(logits + row, mask=mask, other=0.0))
    upstream = tl.where(fine, tl.load(grad_opacities + row, mask=mask, other=0.0), 0.0)
    if FACTOR:
        tl.store(to_factor + row, upstream * opacity, mask=mask)
        upstream *= tl.load(factor + row, mask=mask, other=0.0)
    tl.store(to_logits + row, upstream * opacity * (1 - opacity), mask=mask)


class _Activate(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, bounds: tuple[float, ...], means: Tensor, plane: Tensor, factor: Tensor | None, *columns: Tensor
    ) -> tuple[Tensor, ...]:
        log_scales, quats, logits = columns
        active = torch.empty_like(quats), torch.empty_like(log_scales), torch.empty_like(logits)
        ctx.bounds = bounds
        ctx.save_for_backward(means, plane, factor, *columns)
        if len(means):
            held = logits if factor is None else factor
            sizes = (len(means), *bounds, factor is not None, BLOCK)
            grid = (triton.cdiv(len(means), BLOCK),)
            _activate[grid](means, log_scales, quats, logits, held, plane, *active, *sizes)
        return active

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        means, plane, factor, log_scales, quats, logits = ctx.saved_tensors
        to = torch.empty_like(log_scales), torch.empty_like(quats), torch.empty_like(logits)
        to_factor = None if factor is None else torch.empty_like(factor)
        if len(means):
            held = (logits, to[2]) if factor is None else (factor, to_factor)
            sizes = (len(means), *ctx.bounds, factor is not None, BLOCK)
            given = (gradient.contiguous() for gradient in upstream)
            _activate_gradient[(triton.cdiv(len(means), BLOCK),)](
                means, log_scales, quats, logits, held[0], plane, *given, *to, held[1], *sizes
            )
        return None, None, None, to_factor, *to


def activated_by_triton(
    means: Float[Tensor, "N 3"],
    log_scales: Float[Tensor, "N 3"],
    quats: Float[Tensor, "N 4"],
    opacity_logits: Float[Tensor, "N"],
    opacity_factor: Float[Tensor, "N"] | None,
    plane: Float[Tensor, "4"],
    bounds: tuple[float, ...],
) -> tuple[Float[Tensor, "N 4"], Float[Tensor, "N 3"], Float[Tensor, "N"]]:
    """Quaternions, scales and opacities. ``plane`` is the camera's row of z; ``bounds`` are the nearest depth, the
    logarithm of the widest scale at depth one, the farthest coordinate and the shortest quaternion, squared."""
    factor = None if opacity_factor is None else opacity_factor.contiguous()
    columns = (column.contiguous() for column in (log_scales, quats, opacity_logits))
    quats, scales, opacities = _Activate.apply(bounds, means.detach().contiguous(), plane, factor, *columns)
    return quats, scales, opacities
