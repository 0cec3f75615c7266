"""Which numbers are not finite, in words."""

from collections.abc import Mapping

import torch
from torch import Tensor

NAMED_ROWS = 3
"""Rows that a message names; of the others it gives the number."""


def first_not_finite(tensors: Mapping[str, Tensor]) -> str | None:
    """Says of the first tensor that holds a NaN or an infinity its name, the first such value, and which rows hold one.

    None where all numbers are finite. A scalar is one row.
    """
    for name, tensor in tensors.items():
        if not tensor.is_floating_point() or _is_finite(tensor):
            continue
        values = tensor.detach().reshape(tensor.shape[0] if tensor.ndim else 1, -1)
        broken = ~values.isfinite()
        rows = broken.any(1).nonzero()[:, 0].tolist()
        value = values[rows[0]][broken[rows[0]]][0].item()
        named = ", ".join(str(row) for row in rows[:NAMED_ROWS])
        others = f" and {len(rows) - NAMED_ROWS} more" if len(rows) > NAMED_ROWS else ""
        return f"{name} holds {value} in row{'s' if len(rows) > 1 else ''} {named}{others}"
    return None


def _is_finite(tensor: Tensor) -> bool:
    """Least and largest value hand on NaN and infinity; a table of truths for each number would cost ten times that."""
    if tensor.numel() == 0:
        return True
    low, high = torch.aminmax(tensor.detach())
    return bool(low.isfinite() and high.isfinite())
