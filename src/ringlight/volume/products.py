"""Products of two matrices in pieces that threads share."""

from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.shared_pieces import do_all
from ringlight.volume.halves import ROWS, even_rows

PIECE = 2 * ROWS
"""Rows or columns of a piece: few enough that two threads share most products, and a millisecond's work or more of
those that matter."""


def product(
    rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"], dtype: torch.dtype | None = None
) -> Float[Tensor, "N s"]:
    """Theirs, perhaps as another ``dtype`` once it is found; on a CPU in pieces, of so many rows that there are few
    programs, and differentiable once."""
    dtype = dtype or rows.dtype
    if not rows.is_cpu:
        return (rows @ matrix).to(dtype)
    found: Tensor = _Product.apply(rows, matrix, dtype)
    return found


class _Product(torch.autograd.Function):
    """Pieces are rows of what is found, and columns of the matrix's gradient: each number is one thread's sum."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, matrix: Tensor, dtype: torch.dtype) -> Tensor:
        even = _even(rows, rows.dtype)
        ctx.save_for_backward(even, matrix)
        return by_rows(even, matrix, dtype)[: len(rows)]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        rows, matrix = ctx.saved_tensors
        of_rows, of_matrix, _ = ctx.needs_input_grad
        gradient = _even(gradients[0], rows.dtype)
        return (
            by_rows(gradient, matrix.T)[: len(gradients[0])] if of_rows else None,
            by_columns(rows.T, gradient) if of_matrix else None,
            None,
        )


def by_rows(
    rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"], dtype: torch.dtype | None = None
) -> Float[Tensor, "N s"]:
    """Their product, perhaps as another ``dtype``; a piece is some of the rows."""
    found = rows.new_empty(len(rows), matrix.shape[1], dtype=dtype or rows.dtype)
    parts = zip(rows.split(PIECE), found.split(PIECE), strict=True)

    def make(part: Tensor, to: Tensor) -> None:
        if to.dtype == part.dtype:
            torch.mm(part, matrix, out=to)
        else:
            to.copy_(part @ matrix)  # while it is near

    do_all([partial(make, part, to) for part, to in parts], rows.device)
    return found


def by_columns(rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "N s"]:
    """Their product; a piece is some of the matrix's columns."""
    found = rows.new_empty(len(rows), matrix.shape[1])

    def make(columns: slice) -> None:
        found[:, columns] = rows @ matrix[:, columns]

    starts = range(0, matrix.shape[1], PIECE)
    do_all([partial(make, slice(start, start + PIECE)) for start in starts], rows.device)
    return found


def _even(matrix: Float[Tensor, "N s"], dtype: torch.dtype) -> Float[Tensor, "M s"]:
    """Of another type, and perhaps with zeros after its rows; a piece is some of them."""
    count = len(matrix)
    rows = even_rows(count, dtype)
    if matrix.dtype == dtype and rows == count:
        return matrix
    found = matrix.new_empty(rows, matrix.shape[1], dtype=dtype)
    found[count:] = 0
    parts = zip(found[:count].split(PIECE), matrix.split(PIECE), strict=True)
    do_all([partial(to.copy_, part) for to, part in parts], matrix.device)
    return found
