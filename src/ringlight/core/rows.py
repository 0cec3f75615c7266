"""Rows of a tensor by their numbers, by the operation whose gradient is the faster one on the tensor's device."""

from jaxtyping import Float, Int
from torch import Tensor


def rows_at(values: Float[Tensor, "K *D"], rows: Int[Tensor, "N"]) -> Float[Tensor, "N *D"]:
    """``values[rows]``.

    On a GPU the gradient of indexing sorts the numbers first, where that of ``index_select`` adds in any order. On a
    CPU the latter walks over the rows one by one.
    """
    return values.index_select(0, rows) if values.is_cuda else values[rows]
