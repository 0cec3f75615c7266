"""The eight nodes around a point, by their paths through a tensor train, and the share that each has in it."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.volume.tensor_train import spread_bits
from ringlight.volume.tt_ranks import AXES

CORNERS = 8


@dataclass(frozen=True)
class Corners:
    """Corner 4 i + 2 j + k is after a point along x if i is 1, along y if j is, and along z if k is.

    ``paths`` [N 8] are numbers of nodes in Morton order, int32; ``shares`` [N 8] add up to one.
    """

    paths: Int[Tensor, "N 8"]
    shares: Float[Tensor, "N 8"]


def corners_of(points: Float[Tensor, "N 3"], levels: int) -> Corners:
    """Of points in [0, 1]^3, clamped. Node i of S lies at i / S; behind the last one there is nothing but its value."""
    side = 1 << levels
    places = points.clamp(0, 1) * side
    low = places.detach().floor().clamp_max(side - 1)
    after = places - low
    low = low.long()
    spread = spread_bits(side).to(points.device)
    ends = torch.stack([spread[low], spread[(low + 1).clamp_max(side - 1)]], -1)  # [N 3 2]
    shares = torch.stack([1 - after, after], -1)
    x, y, z = (ends[:, axis] << (AXES - 1 - axis) for axis in range(AXES))
    paths = x[:, :, None, None] | y[:, None, :, None] | z[:, None, None, :]
    products = shares[:, 0, :, None, None] * shares[:, 1, None, :, None] * shares[:, 2, None, None, :]
    return Corners(paths.flatten(1), products.flatten(1))
