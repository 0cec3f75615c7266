"""The learnable visibility mask (RingLight-GS, eq. 10; after Compact 3DGS): a step forward, a sigmoid backward."""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels


def mask_factor(logits: Float[Tensor, "N"], threshold: float) -> Float[Tensor, "N"]:
    """One where sigmoid(logit) > threshold and zero elsewhere, exactly; no gradient is recorded."""
    if not _runs_native(logits):
        return straight_through_reference(logits.detach(), threshold)
    factor = torch.empty_like(logits)
    _kernels.straight_through(logits.contiguous(), threshold, factor[:, None])
    return factor


def mask_gradient(logits: Float[Tensor, "N"], grad_factor: Float[Tensor, "N"]) -> Float[Tensor, "N"]:
    """The way back of :func:`mask_factor`: the sigmoid's."""
    if not _runs_native(logits):
        return torch.ops.aten.sigmoid_backward(grad_factor, logits.sigmoid())
    gradient = torch.empty_like(logits)
    _kernels.straight_through_gradient(logits.contiguous(), grad_factor.contiguous()[:, None], gradient)
    return gradient


def straight_through_reference(logits: Float[Tensor, "N"], threshold: float) -> Float[Tensor, "N"]:
    """Both in torch operations, differentiable, on any device."""
    soft = logits.sigmoid()
    hard = (soft.detach() > threshold).to(soft)
    # soft - soft is exactly zero, so the sum keeps the value of the step and the gradient of the sigmoid.
    return hard + (soft - soft.detach())


def _runs_native(logits: Tensor) -> bool:
    return logits.dtype == torch.float32 and logits.is_cpu
