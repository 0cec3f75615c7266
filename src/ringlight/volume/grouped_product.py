"""Rows in groups, each group times a matrix of its own."""

from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor


class _GroupedProduct(torch.autograd.Function):
    """One node of the graph for all groups, of which there may be a thousand."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, matrices: Tensor, ends: list[int]) -> Tensor:
        ctx.save_for_backward(rows, matrices)
        ctx.ends = ends
        products = rows.new_empty(len(rows), matrices.shape[1])
        for matrix, begin, end in zip(matrices, ends[:-1], ends[1:], strict=True):
            torch.mm(rows[begin:end], matrix.T, out=products[begin:end])
        return products

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, None]:
        rows, matrices = ctx.saved_tensors
        (gradient,) = gradients
        of_rows, of_matrices = torch.empty_like(rows), torch.empty_like(matrices)
        for group, (begin, end) in enumerate(pairwise(ctx.ends)):
            part = gradient[begin:end]
            torch.mm(part, matrices[group], out=of_rows[begin:end])
            torch.mm(part.T, rows[begin:end], out=of_matrices[group])
        return of_rows, of_matrices, None


def grouped_product(
    rows: Float[Tensor, "Q s"], matrices: Float[Tensor, "B C s"], ends: Int[Tensor, "E"]
) -> Float[Tensor, "Q C"]:
    """Group b is the rows from ends[b] up to ends[b + 1]; each is multiplied by the matrix of its group."""
    product: Tensor = _GroupedProduct.apply(rows, matrices.contiguous(), ends.tolist())
    return product
