"""What one view hid when it was last drawn, for those who draw it again and again."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.rasterize.convention import TILE


class Horizon:
    """How deep each tile of a view can be seen into: what lies behind its opaque Gaussians need not be sorted.

    It belongs to whoever knows the view, and a back end renews it with every picture. It is a guess: the table may have
    changed since, even in size. A tile that turns out not to be opaque before its horizon is drawn again with all that
    it holds, so that image and gradients have the same bits whatever the depths are. Back ends may ignore it.
    """

    def __init__(self) -> None:
        self.depths: Float[Tensor, "rows columns"] = torch.empty(0, 0)
        """Camera z for each tile of 32 x 32 pixels; infinity where nothing is hidden."""

    def sized(self, width: int, height: int) -> Float[Tensor, "rows columns"]:
        """The depths; all infinite at first, and where the image has had another number of tiles."""
        shape = (-(-height // TILE), -(-width // TILE))
        if self.depths.shape != shape:
            self.depths = torch.full(shape, math.inf, dtype=torch.float32)
        return self.depths
