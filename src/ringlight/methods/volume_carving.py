"""What masks show to be empty of a volume, before anything is learned.

Fog is what costs a volume time: until it has found its surfaces, each sample of each ray has a colour. Outside the
visual hull there is none from the first step on.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.data.hull import Mask, depths_inside
from ringlight.volume.occupancy import cells_of, centers

UNSEEN = 0.0
"""Share of the views that must see a cell which is left: what is carved never comes back, so a mask has to say so."""


def carved(masks: Sequence[Mask], box: Float[Tensor, "2 3"], nodes: int) -> Bool[Tensor, "X Y Z"] | None:
    """Cells of ``box``, world units, that the masks leave; None where these leave nothing, or there are none.

    As many as a grid with ``nodes`` along the longest side has at most. A cell is left if no mask that sees its centre
    has it further outside the subject than the cell's longest side.
    """
    if not masks:
        return None
    cells = cells_of(box, nodes)
    sides = (box[1] - box[0]) / torch.tensor(cells)
    reach = float(sides.max())
    places = box[0] + centers(cells) * (box[1] - box[0])
    left = (depths_inside(places, masks, reach, UNSEEN) > -reach).view(cells)
    return left if left.any() else None
