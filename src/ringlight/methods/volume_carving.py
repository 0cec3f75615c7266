"""What masks show to be empty of a volume, before anything is learned.

Fog is what costs a volume time: until it has found its surfaces, each sample of each ray has a colour. Outside the
visual hull there is none from the first step on.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.data.hull import Mask, depths_inside
from ringlight.volume.contract import Sides
from ringlight.volume.occupancy import Carving, cells_of, centers, widened

UNSEEN = 0.0
"""Share of the views that must see a cell which is left: what is carved never comes back, so a mask has to say so."""

DOUBT = 2.0
"""Pixels by which masks and cameras may be wrong: silhouettes are blurred by one, and poses are found."""


def reach(masks: Sequence[Mask], box: Float[Tensor, "2 3"], cell: float) -> float:
    """How far outside a silhouette a place may be and still be left, world units: a ``cell``, or DOUBT pixels at the
    box's middle where these are more, by the median of the views."""
    middle = box.mean(0)
    pixels = [float((mask.camera.position - middle).norm()) / max(mask.camera.focal) for mask in masks]
    return max(cell, DOUBT * float(torch.tensor(pixels).median()))


def carved(masks: Sequence[Mask], box: Float[Tensor, "2 3"], nodes: int) -> Bool[Tensor, "X Y Z"] | None:
    """Cells of ``box``, world units, that the masks leave; None where these leave nothing, or there are none.

    As many as a grid with ``nodes`` along the longest side has at most. A cell is left if no mask that sees its centre
    has it further outside the subject than :func:`reach` of the cell's longest side.
    """
    if not masks:
        return None
    cells = cells_of(box, nodes)
    places, outside = places_asked(cells, masks, box)
    left = (depths_inside(places, masks, outside, UNSEEN) > -outside).view(cells)
    return left if left.any() else None


def places_asked(cells: Sides, masks: Sequence[Mask], box: Float[Tensor, "2 3"]) -> tuple[Float[Tensor, "P 3"], float]:
    """Centres of all ``cells`` of ``box``, world units, and how far outside a mask they may be."""
    sides = (box[1] - box[0]) / torch.tensor(cells)
    return box[0] + centers(cells) * (box[1] - box[0]), reach(masks, box, float(sides.max()))


def limit_of(box: Float[Tensor, "2 3"], left: Bool[Tensor, "X Y Z"]) -> Carving:
    """Beyond which no look at empty space may go: what carving left and a cell more around it, since masks err."""
    return Carving(box, widened(left))
