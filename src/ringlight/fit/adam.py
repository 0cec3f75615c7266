"""Adam (Kingma & Ba 2015, algorithm 1): one call of a kernel for all parameters of a step, and its reference."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.gradients import AdamStep, Gradient, dense
from ringlight.core.triton_kernels import runs_triton
from ringlight.fit.rates import Adam


class Update(NamedTuple):
    """One parameter's update: ``value`` and both moments change in place."""

    value: Tensor
    gradient: Gradient
    mean: Tensor
    square: Tensor
    group: Adam
    rate: float
    number: int
    """Counts this parameter's updates; the first is 1."""

    @property
    def step(self) -> AdamStep:
        """As the kernels take it."""
        return (self.rate, *self.group.betas, self.group.epsilon, self.number)


def adam_(updates: Sequence[Update], radii: Float[Tensor, "N 2"] | None = None) -> int:
    """Do all updates. With ``radii`` only in rows that were drawn, those with a radius above 0; all must have N rows.

    Rows that are left out keep value and moments; nothing decays. So does an element of which any would not be finite
    afterwards, because its gradient is not or is too large to be squared; returns how many those are. Gradients in
    factors come first: their factors may be parameters that others update.
    """
    kept = 0
    native: list[tuple[Tensor, Tensor, Tensor, Tensor, AdamStep]] = []
    others: list[Update] = []
    on_gpu: list[Update] = []
    for update in updates:
        gradient = update.gradient
        if runs_triton(update.value):
            on_gpu.append(update)
        elif not _runs_native(update.value):
            others.append(update)
        elif isinstance(gradient, Tensor):
            native.append((update.value, gradient.contiguous(), update.mean, update.square, update.step))
        elif radii is not None:
            native.append((update.value, gradient.dense(), update.mean, update.square, update.step))
        else:
            kept += gradient.adam_(update.value, update.mean, update.square, update.step)
            torch.autograd.graph.increment_version(update.value)
    if native:
        values, gradients, means, squares, steps = zip(*native, strict=True)
        kept += _kernels.adam(values, gradients, means, squares, steps, radii)
        # The kernel writes behind torch's back: a graph that still needs the old values must notice.
        torch.autograd.graph.increment_version(values)
    for update in others:
        kept += adam_reference_(update, radii)
    return kept + (_adam_on_gpu_(on_gpu, radii) if on_gpu else 0)


def _adam_on_gpu_(updates: Sequence[Update], radii: Float[Tensor, "N 2"] | None) -> int:
    """All by one launch; a parameter whose memory is not contiguous by torch."""
    from ringlight.fit.adam_triton import adam_by_triton_

    kept, groups = 0, []
    for update in updates:
        tensors = (update.value, update.mean, update.square)
        if not all(tensor.is_contiguous() for tensor in tensors):
            kept += adam_reference_(update, radii)
            continue
        groups.append((update.value, dense(update.gradient).contiguous(), update.mean, update.square, update.step))
    if groups:
        kept += int(adam_by_triton_(groups, radii))
        torch.autograd.graph.increment_version([group[0] for group in groups])
    return kept


def adam_reference_(update: Update, radii: Float[Tensor, "N 2"] | None = None) -> int:
    """The reference of the kernel, for any device and type."""
    value, gradient, mean, square, group, rate, number = update
    gradient = dense(gradient)
    beta1, beta2 = group.betas
    if radii is not None:
        drawn = (radii[:, 0] > 0).to(value.device).nonzero()[:, 0]
        chosen = Update(value[drawn], gradient[drawn], mean[drawn], square[drawn], group, rate, number)
        kept = adam_reference_(chosen)
        for whole, part in zip((value, mean, square), (chosen.value, chosen.mean, chosen.square), strict=True):
            whole[drawn] = part
        return kept
    new_mean = mean.lerp(gradient, 1 - beta1)
    new_square = (square * beta2).addcmul_(gradient, gradient, value=1 - beta2)
    denominator = (new_square / (1 - beta2**number)).sqrt_().add_(group.epsilon)
    new_value = value.addcdiv(new_mean, denominator, value=-rate / (1 - beta1**number))
    fine = new_mean.isfinite() & new_square.isfinite() & new_value.isfinite()
    for whole, part in zip((value, mean, square), (new_value, new_mean, new_square), strict=True):
        whole.copy_(torch.where(fine, part, whole))
    return int((~fine).sum())


def _runs_native(value: Tensor) -> bool:
    return value.is_cpu and value.dtype == torch.float32 and value.is_contiguous()
