"""A model as it was at an earlier step, whose pictures another one learns from while it is there."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.want import Want
from ringlight.models.splats import SplatModel


class Teacher:
    """``model`` has no rows, and takes those of another of its form."""

    def __init__(self, model: SplatModel):
        self.model = model

    @property
    def is_there(self) -> bool:
        """Whether it has anything to show."""
        return len(self.model) > 0

    def become(self, model: SplatModel) -> None:
        """A copy of this ``model`` as it is now."""
        self.model.load_tensors(model.state_dict())

    def go(self) -> None:
        """Forget what it was."""
        self.model.load_columns({name: column[:0] for name, column in self.model.columns.items()})

    @torch.no_grad()
    def picture(self, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "3 H W"]:
        """What it shows, in [0, 1]."""
        return self.model.render(camera, background, Want.EXACT).color.clamp(0, 1).permute(2, 0, 1)

    def state(self) -> dict[str, Tensor]:
        """Its columns, and its switches."""
        return dict(self.model.state_dict())

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`. Raises ValueError for columns of different lengths."""
        if len({len(tensor) for name, tensor in state.items() if name.startswith(COLUMNS)}) > 1:
            raise ValueError("the teacher's columns have different numbers of rows")
        self.model.load_tensors(state)
