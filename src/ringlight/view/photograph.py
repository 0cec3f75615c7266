"""A photograph where a browser's camera shows its pixels."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample, interpolate

from ringlight.core.camera import Camera

NOTHING = 0.5
"""Gray where nobody took a photograph."""


def placed(photograph: Float[Tensor, "3 h w"], taken: Camera, seen: Camera) -> Float[Tensor, "H W 3"]:
    """The ``photograph``, in [0, 1], by a camera ``taken``, in the picture of a camera ``seen`` of the same pose.

    Two pinholes in one place that look one way differ by a scale and a shift of the picture.
    """
    factor = seen.focal[1] / taken.focal[1]
    if factor < 1:  # else samples would skip pixels
        sides = (max(round(taken.height * factor), 1), max(round(taken.width * factor), 1))
        photograph = interpolate(photograph[None], sides, mode="bilinear", antialias=True, align_corners=False)[0]
    x = _sought(seen.width, seen.center[0], seen.focal[0], taken.width, taken.center[0], taken.focal[0])
    y = _sought(seen.height, seen.center[1], seen.focal[1], taken.height, taken.center[1], taken.focal[1])
    rows, columns = torch.meshgrid(y, x, indexing="ij")
    grid = torch.stack([columns, rows], -1)
    found = grid_sample(photograph[None], grid[None], mode="bilinear", padding_mode="border", align_corners=False)[0]
    inside = ((grid.abs() <= 1).all(-1)).float()
    return (found * inside + NOTHING * (1 - inside)).permute(1, 2, 0)


def _sought(side: int, center: float, focal: float, of: int, its_center: float, its_focal: float) -> Tensor:
    """Where in the photograph, from -1 to 1 over its side, the picture's pixel centres lie."""
    offsets = (torch.arange(side, dtype=torch.float64) + 0.5 - center) / focal
    return (2 * (offsets * its_focal + its_center) / of - 1).float()
