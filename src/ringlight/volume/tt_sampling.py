"""A tensor train's values between its nodes: of the whole grid, of the blocks that points touch, or of points alone.

All three give the same numbers, of the points' type; cores may be of a shorter one, and are multiplied as that.
``from_grid`` contracts every entry (PuTT's way).
``from_blocks`` contracts the first cores for the blocks of nodes that have a point in them, and all entries of these.
``from_points`` never writes entries down: what the last cores make of a point's corners is interpolated first, and
meets the matrix of the first ones after that.

The box is a cube here, of as many nodes along each axis. Where the first core has four octants, or two, points are in
the lower half of it along x, or x and y, and no further than the last node there.
"""

from jaxtyping import Float
from torch import Tensor

from ringlight.volume.products import product
from ringlight.volume.tensor_train import Cores, contracted, suffixes
from ringlight.volume.tt_bags import bag_sums
from ringlight.volume.tt_blocks import blocks_of, corner_bags, parts_of, whole
from ringlight.volume.tt_prefixes import some_prefixes
from ringlight.volume.tt_products import part_products


def from_grid(cores: Cores, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
    """By all entries of the grid."""
    entries = whole(len(cores), points.device, cores[0].shape[1])
    return bag_sums(contracted(cores).T.to(points.dtype), corner_bags(points, entries))


def from_blocks(cores: Cores, points: Float[Tensor, "N 3"], first: int) -> Float[Tensor, "N C"]:
    """By the entries of blocks that the ``first`` cores tell apart."""
    if not len(points):
        return points.new_zeros(0, len(cores[0]))
    blocks = blocks_of(points, len(cores), first)
    before, after = some_prefixes(cores[:first], blocks.paths), suffixes(cores[first:])
    width = before.shape[1]
    entries = product(before.flatten(0, 1), after, points.dtype)
    rows = entries.view(len(before), width, -1).transpose(1, 2).reshape(-1, width)
    return bag_sums(rows, corner_bags(points, blocks))


def from_points(cores: Cores, points: Float[Tensor, "N 3"], first: int) -> Float[Tensor, "N C"]:
    """By what the cores after the ``first`` make of each point. A point between blocks is taken by parts, a block
    each."""
    if not len(points):
        return points.new_zeros(0, len(cores[0]))
    blocks = blocks_of(points, len(cores), first)
    parts = parts_of(points, blocks)
    before, after = some_prefixes(cores[:first], blocks.paths), suffixes(cores[first:]).T
    return part_products(parts, before.to(points.dtype), after.to(points.dtype))
