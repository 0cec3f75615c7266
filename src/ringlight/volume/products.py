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


def product(rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "N s"]:
    """Theirs; on a CPU in pieces, of so many rows that there are few programs, and differentiable once."""
    if not rows.is_cpu:
        return rows @ matrix
    count = len(rows)
    more = even_rows(count, rows.dtype) - count
    found: Tensor = _Product.apply(torch.nn.functional.pad(rows, (0, 0, 0, more)) if more else rows, matrix)
    return found[:count] if more else found


class _Product(torch.autograd.Function):
    """Pieces are rows of what is found, and columns of the matrix's gradient: each number is one thread's sum."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, matrix: Tensor) -> Tensor:
        ctx.save_for_backward(rows, matrix)
        return by_rows(rows, matrix)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None]:
        rows, matrix = ctx.saved_tensors
        of_rows, of_matrix = ctx.needs_input_grad
        gradient = gradients[0]
        return (
            by_rows(gradient, matrix.T) if of_rows else None,
            by_columns(rows.T, gradient) if of_matrix else None,
        )


def by_rows(rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "N s"]:
    """Their product; a piece is some of the rows."""
    found = rows.new_empty(len(rows), matrix.shape[1])
    parts = zip(rows.split(PIECE), found.split(PIECE), strict=True)
    do_all([partial(torch.mm, part, matrix, out=to) for part, to in parts], rows.device)
    return found


def by_columns(rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "N s"]:
    """Their product; a piece is some of the matrix's columns."""
    found = rows.new_empty(len(rows), matrix.shape[1])

    def make(columns: slice) -> None:
        found[:, columns] = rows @ matrix[:, columns]

    starts = range(0, matrix.shape[1], PIECE)
    do_all([partial(make, slice(start, start + PIECE)) for start in starts], rows.device)
    return found
