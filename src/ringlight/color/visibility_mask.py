"""The learnable visibility mask (RingLight-GS, eq. 10; after Compact 3DGS): a step forward, a sigmoid backward."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels


def straight_through_mask(logits: Float[Tensor, "N"], threshold: float) -> Float[Tensor, "N 1"]:
    """One where sigmoid(logit) > threshold and zero elsewhere, exactly; its gradient is the sigmoid's."""
    if logits.dtype != torch.float32 or logits.device.type != "cpu":
        return straight_through_twin(logits, threshold)
    factor: Tensor = _StraightThrough.apply(logits.contiguous(), threshold)
    return factor


def straight_through_twin(logits: Float[Tensor, "N"], threshold: float) -> Float[Tensor, "N 1"]:
    """The same in torch operations, on any device."""
    soft = logits.sigmoid()
    hard = (soft.detach() > threshold).to(soft)
    # soft - soft is exactly zero, so the sum keeps the value of the step and the gradient of the sigmoid.
    return (hard + (soft - soft.detach()))[:, None]


class _StraightThrough(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, logits: Tensor, threshold: float) -> Tensor:
        factor = logits.new_empty(len(logits), 1)
        _kernels.straight_through(logits, threshold, factor)
        ctx.save_for_backward(logits)
        return factor

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None]:
        (logits,) = ctx.saved_tensors
        gradient = torch.empty_like(logits)
        _kernels.straight_through_gradient(logits, upstream.contiguous(), gradient)
        return gradient, None
