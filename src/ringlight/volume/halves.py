"""Whether matrices are multiplied as bfloat16, and their products by pieces that threads share."""

from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight import _kernels
from ringlight.core.side_by_side import side_by_side

HALVES = True
"""Whether products of the network's layers and of a tensor train's cores may be of bfloat16. What that changes:
docs/methods/putt.md."""

FASTER_ON = ("avx512_bf16", "avx512_amx")
"""Kernels' names of processors that multiply these faster."""

ROWS = 256
"""Of matrices of bfloat16 torch takes multiples: it compiles a program for every count of rows it meets."""

PIECE = 2 * ROWS
"""Rows or columns of a product that one thread makes: work for a millisecond where others are as many."""


def multiplies_halves() -> bool:
    """As this processor does it."""
    return HALVES and _kernels.isa() in FASTER_ON


def even_rows(count: int, dtype: torch.dtype) -> int:
    """``count``, or the next number of rows for which there are few programs."""
    return -(-count // ROWS) * ROWS if dtype == torch.bfloat16 else count


def product(rows: Float[Tensor, "N r"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "N s"]:
    """Theirs, of so many rows that there are few programs."""
    count = len(rows)
    more = even_rows(count, rows.dtype) - count
    found: Tensor = _Product.apply(torch.nn.functional.pad(rows, (0, 0, 0, more)) if more else rows, matrix)
    return found[:count] if more else found


class _Product(torch.autograd.Function):
    """Pieces are rows of what is found, and columns of the matrix's gradient: each number is one thread's sum."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, matrix: Tensor) -> Tensor:
        ctx.save_for_backward(rows, matrix)
        return _by_rows(rows, matrix)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None]:
        rows, matrix = ctx.saved_tensors
        of_rows, of_matrix = ctx.needs_input_grad
        gradient = gradients[0]
        return (
            _by_rows(gradient, matrix.T) if of_rows else None,
            _by_columns(rows.T, gradient) if of_matrix else None,
        )


def _by_rows(rows: Tensor, matrix: Tensor) -> Tensor:
    found = rows.new_empty(len(rows), matrix.shape[1])
    parts = zip(rows.split(PIECE), found.split(PIECE), strict=True)
    side_by_side([partial(torch.mm, part, matrix, out=to) for part, to in parts], rows.device)
    return found


def _by_columns(rows: Tensor, matrix: Tensor) -> Tensor:
    found = rows.new_empty(len(rows), matrix.shape[1])

    def make(columns: slice) -> None:
        found[:, columns] = rows @ matrix[:, columns]

    starts = range(0, matrix.shape[1], PIECE)
    side_by_side([partial(make, slice(start, start + PIECE)) for start in starts], rows.device)
    return found
