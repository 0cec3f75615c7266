"""Feature maps of directions: square maps of several sizes over the octahedral square, read bilinearly.

The square of Meyer et al. (2010) as an environment map, its levels side by side as in a multi-resolution grid
(Müller et al. 2022) without hashing: coarse levels say what is blurred, fine ones what is sharp, and whoever reads the
features decides between them. No trigonometry, no poles, and every map is one table.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.triton_kernels import runs_triton

FIRST_DEVIATION = 0.01
"""Standard deviation of new features: small beside colours; not zero, so that the network's weights get gradients."""


def sewn(level: Float[Tensor, "side side F"]) -> Float[Tensor, "side side F"]:
    """The map with equal values where the square's edge shows one direction twice: the mean of the nodes that do.

    Each edge folds on its middle, (u, 1) and (-u, 1) are one direction, and all four corners are one: the -z pole.
    What is read bilinearly is then continuous on the sphere, and no seam shows in a reflection.
    """
    rows = 0.5 * (level[:: len(level) - 1] + level[:: len(level) - 1].flip(1))
    level = torch.cat([rows[:1], level[1:-1], rows[1:]])
    columns = 0.5 * (level[:, :: len(level) - 1] + level[:, :: len(level) - 1].flip(0))
    return torch.cat([columns[:, :1], level[:, 1:-1], columns[:, 1:]], 1)


class OctahedralMaps(nn.Module):
    """``levels.l`` is [side side F] of level l, element (j, i) for node (i, j) of the square's axes (u, v)."""

    def __init__(self, sides: Sequence[int], features: int, generator: torch.Generator):
        super().__init__()
        self.levels = nn.ParameterList(
            torch.empty(side, side, features).normal_(0, FIRST_DEVIATION, generator=generator) for side in sides
        )

    def forward(self, uv: Float[Tensor, "N 2"]) -> Float[Tensor, "N D"]:
        """Features at (u, v) in [-1, 1]^2, first those of the first level; D is levels times F."""
        if runs_triton(uv, *self.levels):
            from ringlight.fields.octahedral_triton import maps_by_triton

            return maps_by_triton(uv, list(self.levels))
        return torch.cat([_between_nodes(sewn(level), uv) for level in self.levels], -1)


def _between_nodes(level: Float[Tensor, "side side F"], uv: Float[Tensor, "N 2"]) -> Float[Tensor, "N F"]:
    """torch's own sampling, whose backward pass adds without the sorting that indexing needs."""
    planar, points = level.permute(2, 0, 1)[None], uv[None, None]
    # True: the first and last node lie on -1 and 1, as in all our tables.
    features = nn.functional.grid_sample(planar, points, align_corners=True, padding_mode="border")
    return features[0, :, 0].T
