"""Splats whose harmonics may be cut to a lower degree while they train; what is above it is not kept in files."""

import torch
from jaxtyping import Bool
from torch import Tensor

from ringlight.core.gradients import COLUMNS
from ringlight.core.sh_basis import basis_count
from ringlight.models.splats import SplatModel

REST = COLUMNS + "sh_rest"


class NarrowedSplats(SplatModel):
    """Spherical harmonics; "sh_rest" keeps its width while it trains, so that checkpoints have one form, and a file
    holds the degree ``narrowed`` once no higher one is in use: 3, 8 or 15 of them, as 3DGS of that degree."""

    narrowed: int = 0
    """Degree that files are cut to; set by whoever builds it."""

    def _needed(self, keep: Bool[Tensor, "N"] | slice) -> dict[str, Tensor]:
        tensors = super()._needed(keep)
        active = self.get_buffer("color.active_degree")
        if active.is_meta or int(active) <= self.narrowed:  # an outline is of a finished model
            tensors[REST] = tensors[REST][:, : basis_count(self.narrowed) - 1].contiguous()
        return tensors


def narrowed_splats(model: SplatModel, degree: int) -> NarrowedSplats:
    """The same model, sharing its tensors, with files cut to ``degree``."""
    with torch.no_grad():
        narrow = NarrowedSplats(model.gaussians, model.color, model.shader, model.rasterize, model.options)
    narrow.narrowed = degree
    return narrow
