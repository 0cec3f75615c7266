"""Points in blocks: what the last cores make of each, interpolated between its nodes, times the matrix of its block."""

from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight import _kernels
from ringlight.volume.tt_bags import reference_sums
from ringlight.volume.tt_blocks import Parts


def part_products(parts: Parts, matrices: Float[Tensor, "B C s"], rows: Float[Tensor, "M s"]) -> Float[Tensor, "N C"]:
    """Of each point the sum of its parts; by the kernel where it runs and shares are constants."""
    shares = parts.bags.shares
    if shares.is_cpu and matrices.dtype == rows.dtype == torch.float32 and not shares.requires_grad:
        found: Tensor = _Products.apply(parts, matrices.contiguous(), rows.contiguous())
        return found
    return reference_products(parts, matrices, rows)


def reference_products(
    parts: Parts, matrices: Float[Tensor, "B C s"], rows: Float[Tensor, "M s"]
) -> Float[Tensor, "N C"]:
    """The same in torch."""
    sums = reference_sums(rows, parts.bags)
    groups = zip(matrices, pairwise(parts.ends.tolist()), strict=True)
    found = torch.cat([sums[begin:end] @ matrix.T for matrix, (begin, end) in groups])
    return found.new_zeros(parts.points, found.shape[-1]).index_add(0, parts.owners, found)


_Bags = tuple[Tensor, Tensor]
_Blocks = tuple[Tensor, Tensor, Tensor, Tensor]


class _Products(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, parts: Parts, matrices: Tensor, rows: Tensor) -> Tensor:
        ctx.parts = parts
        ctx.save_for_backward(matrices, rows)
        found = rows.new_empty(parts.points, matrices.shape[1])
        _kernels.train_products(*_native(parts, matrices, rows), found)
        return found

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor, Tensor]:
        matrices, rows = ctx.saved_tensors
        of_matrices, of_rows = torch.empty_like(matrices), torch.empty_like(rows)
        _kernels.train_products_gradient(
            *_native(ctx.parts, matrices, rows), gradients[0].contiguous(), of_matrices, of_rows
        )
        return None, of_matrices, of_rows


def _native(parts: Parts, matrices: Tensor, rows: Tensor) -> tuple[_Bags, _Blocks]:
    return (parts.bags.index, parts.bags.shares), (parts.ends, parts.owners, matrices, rows)
