"""Adam (Kingma & Ba 2015, algorithm 1): one call of a kernel for all parameters of a step, and its reference."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.gradients import AdamStep, Gradient, dense
from ringlight.core.triton_kernels import runs_triton


class Update(NamedTuple):
    """One parameter's update: ``value`` and both moments change in place."""

    value: Tensor
    gradient: Gradient
    mean: Tensor
    square: Tensor
    step: AdamStep


def adam_(updates: Sequence[Update], radii: Float[Tensor, "N 2"] | None = None) -> int:
    """Do all updates. With ``radii`` only in rows that were drawn, those with a radius above 0; all must have N rows.

    Rows that are left out keep value and moments; nothing decays. So does an element of which any would not be finite
    afterwards, because its gradient is not or is too large to be squared; returns how many those are. Gradients in
    factors come first: their factors may be parameters that others update.
    """
    kept = 0
    native: list[tuple[Tensor, Tensor, Tensor, Tensor, AdamStep]] = []
    on_gpu: list[tuple[Tensor, Tensor, Tensor, Tensor, AdamStep]] = []
    others: list[Update] = []
    for update in updates:
        value, gradient, mean, square, step = update
        by_triton = runs_triton(value)
        takes_any = by_triton or (value.is_cpu and value.dtype == torch.float32)
        if not (takes_any and value.is_contiguous() and mean.is_contiguous() and square.is_contiguous()):
            others.append(update)
        elif isinstance(gradient, Tensor) or radii is not None or by_triton:
            (on_gpu if by_triton else native).append((value, dense(gradient).contiguous(), mean, square, step))
        else:
            kept += gradient.adam_(value, mean, square, step)
            torch.autograd.graph.increment_version(value)
    # Kernels write behind torch's back: a graph that still needs the old values must notice.
    if native:
        values, gradients, means, squares, steps = zip(*native, strict=True)
        kept += _kernels.adam(values, gradients, means, squares, steps, radii)
        torch.autograd.graph.increment_version(values)
    if on_gpu:
        from ringlight.fit.adam_triton import adam_by_triton_

        kept += int(adam_by_triton_(on_gpu, radii))
        torch.autograd.graph.increment_version([value for value, *_ in on_gpu])
    return kept + sum(adam_reference_(update, radii) for update in others)


def adam_reference_(update: Update, radii: Float[Tensor, "N 2"] | None = None) -> int:
    """The reference of the kernel, for any device and type."""
    value, gradient, mean, square, step = update
    gradient, (rate, beta1, beta2, epsilon, number) = dense(gradient), step
    if radii is not None:
        drawn = (radii[:, 0] > 0).to(value.device).nonzero()[:, 0]
        chosen = Update(value[drawn], gradient[drawn], mean[drawn], square[drawn], step)
        kept = adam_reference_(chosen)
        for whole, part in zip((value, mean, square), (chosen.value, chosen.mean, chosen.square), strict=True):
            whole[drawn] = part
        return kept
    new_mean = mean.lerp(gradient, 1 - beta1)
    new_square = (square * beta2).addcmul_(gradient, gradient, value=1 - beta2)
    denominator = (new_square / (1 - beta2**number)).sqrt_().add_(epsilon)
    new_value = value.addcdiv(new_mean, denominator, value=-rate / (1 - beta1**number))
    fine = new_mean.isfinite() & new_square.isfinite() & new_value.isfinite()
    for whole, part in zip((value, mean, square), (new_value, new_mean, new_square), strict=True):
        whole.copy_(torch.where(fine, part, whole))
    return int((~fine).sum())
