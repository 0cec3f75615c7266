"""How many nodes a grid has along each axis of a box, and how that grows."""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.kernel_limits import VOLUME_MOST_NODES as MOST_NODES
from ringlight.volume.contract import Sides

FEWEST_NODES = 2
"""Along an axis: one cell."""


def sides_of(box: Float[Tensor, "2 3"], voxels: float | int) -> Sides:
    """Nodes of about ``voxels`` cubes that fill the box; along an axis of a very long one at most MOST_NODES."""
    lengths = (box[1] - box[0]).double()
    pitch = (lengths.prod().item() / voxels) ** (1 / 3)
    x, y, z = (min(max(int(length / pitch), FEWEST_NODES), MOST_NODES) for length in lengths.tolist())
    return x, y, z


def growing(first: int, last: int, times: int) -> tuple[float, ...]:
    """Voxels after each of so many upsamplings from ``first`` cubed to ``last`` cubed, evenly in their logarithm."""
    logs = [3 * math.log(side) for side in (first, last)]
    return tuple(math.exp(logs[0] + (logs[1] - logs[0]) * (k + 1) / times) for k in range(times))


def nodes_around(
    of_grid: Float[Tensor, "2 3"], box: Float[Tensor, "2 3"], nodes: Sides, intervals: Float[Tensor, "3"]
) -> Int[Tensor, "2 3"]:
    """The first and last of the ``nodes`` that enclose a ``box``, where ``intervals`` of them fill the grid's own; two
    along each axis at least."""
    low, high = of_grid
    last = torch.tensor(nodes).to(of_grid) - 1
    inner = (box.to(of_grid) - low) / (high - low) * intervals
    ends = torch.stack([inner[0].floor(), inner[1].ceil()]).clamp_min(0).minimum(last)
    ends[1] = ends[1].maximum(ends[0] + 1).minimum(last)
    ends[0] = ends[0].minimum(ends[1] - 1)
    return ends.long()
