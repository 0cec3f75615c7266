"""Input that is not finite is refused with its place: drawn or skipped, it would hide whatever made it."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.errors import BackendError

NAMED_ROWS = 3
"""Rows that a message names; of the others it gives the number."""


def refuse_if_not_finite(columns: Mapping[str, Tensor | None], camera: Camera, background: Tensor) -> None:
    """Raise BackendError naming the first column that holds a NaN or an infinity, and the rows; else do nothing.

    ``columns`` have N rows each; None stands for a column that is absent.
    """
    for name, column in columns.items():
        if column is None:
            continue
        values = column.detach().reshape(len(column), column.numel() // max(1, len(column)))
        broken = ~values.isfinite()
        rows = broken.any(1).nonzero()[:, 0].tolist()
        if rows:
            value = values[rows[0]][broken[rows[0]]][0].item()
            raise BackendError(
                f"column {name} holds {value} in {_named(rows)}; remove these rows, or go back to a state from before "
                "and learn at lower rates"
            )
    lens = torch.tensor([*camera.focal, *camera.center])
    for what, values in (("background", background), ("camera's pose", camera.world_to_camera), ("lens", lens)):
        if not values.isfinite().all():
            raise BackendError(f"the {what} holds a value that is not finite; only finite numbers can be drawn")


def _named(rows: list[int]) -> str:
    named = ", ".join(str(row) for row in rows[:NAMED_ROWS])
    others = len(rows) - NAMED_ROWS
    return f"row{'s' if len(rows) > 1 else ''} {named}" + (f" and {others} more" if others > 0 else "")
