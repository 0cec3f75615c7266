"""Sums of eight rows each, times their shares: what lies between nodes."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight import _kernels


@dataclass(frozen=True)
class Bags:
    """Of each sum the numbers of its rows, int32, and their shares."""

    index: Int[Tensor, "N 8"]
    shares: Float[Tensor, "N 8"]


def bag_sums(rows: Float[Tensor, "M C"], bags: Bags) -> Float[Tensor, "N C"]:
    """By the kernels where these run and shares are constants."""
    if rows.is_cpu and rows.dtype == torch.float32 and not bags.shares.requires_grad:
        found: Tensor = _Sums.apply(rows.contiguous(), bags)
        return found
    return reference_sums(rows, bags)


def reference_sums(rows: Float[Tensor, "M C"], bags: Bags) -> Float[Tensor, "N C"]:
    """The same in torch."""
    if rows.shape[1] == 1:
        # The way back of indexing adds in any order; that of this adds in theirs.
        corners = rows[:, 0].index_select(0, bags.index.flatten()).view_as(bags.index)
        return (corners * bags.shares).sum(-1, keepdim=True)
    return torch.nn.functional.embedding_bag(bags.index.long(), rows, mode="sum", per_sample_weights=bags.shares)


class _Sums(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, bags: Bags) -> Tensor:
        ctx.bags, ctx.count = bags, len(rows)
        found = rows.new_empty(len(bags.index), rows.shape[1])
        _kernels.train_gather((bags.index, bags.shares), rows, found)
        return found

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        gradient = gradients[0].contiguous()
        rows = gradient.new_zeros(ctx.count, gradient.shape[1])
        _kernels.train_scatter((ctx.bags.index, ctx.bags.shares), gradient, rows)
        return rows, None
