"""Several channels as one tensor, and one image as several: without a copy where they are neighbours in memory.

Plain ``torch.cat`` and ``split`` would copy eleven planes four times a step, and turn planar gradients inside out.
"""

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


def joined(values: Sequence[Float[Tensor, "N _"]]) -> Float[Tensor, "N C"]:
    """The columns side by side; what they were cut from, if they are all of it, in order."""
    whole = values[0]._base
    if whole is None or whole.dim() != 2 or not _are_all_of(whole, values):
        return torch.cat(list(values), -1)
    return whole


def _are_all_of(whole: Tensor, parts: Sequence[Tensor]) -> bool:
    """Whether the parts are the columns of ``whole``, in order, with the same way back for their gradients."""
    end = 0
    for part in parts:
        same = part._base is whole and part.stride() == whole.stride() and part.requires_grad == whole.requires_grad
        if not same or part.shape[0] != whole.shape[0] or part.storage_offset() != whole.storage_offset() + end:
            return False
        end += part.shape[1]
    return end == whole.shape[1]


def parted(image: Float[Tensor, "H W C"], widths: Sequence[int]) -> tuple[Float[Tensor, "H W _"], ...]:
    """The image's channels in parts, which share its memory; the gradient is planar, as its own memory."""
    parts: tuple[Tensor, ...] = _Parted.apply(image, tuple(widths))
    return parts


class _Parted(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, widths: tuple[int, ...]) -> tuple[Tensor, ...]:
        ctx.set_materialize_grads(False)
        ctx.widths, ctx.like = widths, image.new_empty(0)
        ctx.size = image.shape[:2]
        return image.split(widths, -1)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor, None]:
        whole = _neighbours(gradients)
        if whole is not None:
            return whole.permute(1, 2, 0), None
        planes = ctx.like.new_empty(sum(ctx.widths), *ctx.size)
        for to, gradient in zip(planes.split(ctx.widths), gradients, strict=True):
            if gradient is None:
                to.zero_()
            else:
                to.copy_(gradient.permute(2, 0, 1))
        return planes.permute(1, 2, 0), None


def _neighbours(gradients: Sequence[Tensor | None]) -> Float[Tensor, "C H W"] | None:
    """The memory of all, if they are planar and follow one another in one storage."""
    first, count = gradients[0], 0
    if first is None:
        return None
    height, width = first.shape[:2]
    for part in gradients:
        if part is None or part.untyped_storage()._cdata != first.untyped_storage()._cdata:
            return None
        planar = part.stride() == (width, 1, height * width) or (part.shape[2] == 1 and part.stride()[:2] == (width, 1))
        if not planar or part.storage_offset() != first.storage_offset() + count * height * width:
            return None
        count += part.shape[2]
    return first.as_strided((count, height, width), (height * width, width, 1))
