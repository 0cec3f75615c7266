"""Which numbers are not finite, in words."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

NAMED_ROWS = 3
"""Rows that a message names; of the others it gives the number."""


@dataclass(frozen=True)
class NotFinite:
    """A tensor that holds a NaN or an infinity: its name, the first such value, and the rows that hold one."""

    name: str
    value: float
    rows: tuple[int, ...]

    def __str__(self) -> str:
        named = ", ".join(str(row) for row in self.rows[:NAMED_ROWS])
        others = len(self.rows) - NAMED_ROWS
        rows = f"row{'s' if len(self.rows) > 1 else ''} {named}" + (f" and {others} more" if others > 0 else "")
        return f"{self.name} holds {self.value} in {rows}"


def first_not_finite(tensors: Mapping[str, Tensor]) -> NotFinite | None:
    """The first tensor that holds a NaN or an infinity; None where all numbers are finite. A scalar is one row."""
    for name, tensor in tensors.items():
        if not tensor.is_floating_point() or _is_finite(tensor):
            continue
        values = tensor.detach().reshape(tensor.shape[0] if tensor.ndim else 1, -1)
        broken = ~values.isfinite()
        rows = broken.any(1).nonzero()[:, 0].tolist()
        return NotFinite(name, values[rows[0]][broken[rows[0]]][0].item(), tuple(rows))
    return None


def _is_finite(tensor: Tensor) -> bool:
    """Least and largest value hand on NaN and infinity; a table of truths for each number would cost ten times that."""
    if tensor.numel() == 0:
        return True
    low, high = torch.aminmax(tensor.detach())
    return bool(low.isfinite() and high.isfinite())
