"""Input that is not finite is refused with its place: drawn or skipped, it would hide whatever made it."""

from collections.abc import Mapping

from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.finite import first_not_finite
from ringlight.errors import BackendError


def refuse_if_not_finite(columns: Mapping[str, Tensor | None], camera: Camera, background: Tensor) -> None:
    """Raise BackendError naming what holds a NaN or an infinity: background, pose or lens, of which channels are made,
    or else the first such column and its rows. Do nothing where all are finite.

    ``columns`` have N rows each; None stands for a column that is absent.
    """
    if not background.isfinite().all():
        raise BackendError("the background holds a value that is not finite; only finite numbers can be drawn")
    camera.refuse_if_not_finite()
    broken = first_not_finite({name: column for name, column in columns.items() if column is not None})
    if broken is not None:
        raise BackendError(
            f"column {broken}: numbers beyond what can be drawn; remove these rows, or copy or train the model again"
        )
