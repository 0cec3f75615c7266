"""What masks show to be empty of a volume, before anything is learned.

Fog is what costs a volume time: until it has found its surfaces, each sample of each ray has a colour. Outside the
visual hull there is none from the first step on.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.data.hull import Mask, depths_inside, objections
from ringlight.data.rays import Rays
from ringlight.volume.looked_for import AT_ONCE
from ringlight.volume.marching import Space, samples_of
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import Carving, cells_of, centers, everything, widened

UNSEEN = 0.0
"""Share of the views that must see a cell which is left: what is carved never comes back, so a mask has to say so."""

DOUBT = 2.0
"""Pixels by which masks and cameras may be wrong: silhouettes are blurred by one, and poses are found."""

FEWEST = 2
"""Masks that must have a cell outside for it to be carved, where masks are not all right."""

MOST_WRONG = 0.25
"""Share of the masks that may be wrong about a place. Where more of them have all of a ray outside the subject, it is
the mask of the ray's own photograph that is."""

MOST_LOST = 1 << 18
"""Rays that are followed, evenly chosen where more meet nothing: neighbours go through the same cells."""


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
    sides = (box[1] - box[0]) / torch.tensor(cells)
    outside = reach(masks, box, float(sides.max()))
    places = box[0] + centers(cells) * (box[1] - box[0])
    left = (depths_inside(places, masks, outside, UNSEEN) > -outside).view(cells)
    return left if left.any() else None


def given_back(
    left: Bool[Tensor, "X Y Z"],
    model: VolumeModel,
    masks: Sequence[Mask],
    lost: Int[Tensor, "R"],
    through: Callable[[Int[Tensor, "R"]], Rays],
) -> Bool[Tensor, "X Y Z"]:
    """The cells of ``model``'s box that are ``left``, and those that wrong masks have carved.

    ``lost`` are numbers of rays of the subject that meet nothing of what is left, and ``through`` makes them: masks
    contradict each other there. So what fewer than FEWEST have outside comes back. The subject is somewhere on the way
    of each of these rays, so those cells along it come back, too, that the fewest masks have outside, if these are at
    most the share MOST_WRONG.
    """
    lost = lost[:: -(-len(lost) // MOST_LOST)]
    space = replace(model.looked_through(), occupied=everything(), occupied_box=model.box)
    box = model.box.cpu()
    x, y, z = left.shape
    sides = (box[1] - box[0]) / torch.tensor((x, y, z))
    places = box[0] + centers((x, y, z)) * (box[1] - box[0])
    against = objections(places, masks, reach(masks, box, float(sides.max()))).view(left.shape)
    found = left | (against < FEWEST)
    for part in lost.split(AT_ONCE):
        ray, cells = _cells_along(through(part), space, left)
        least = torch.full((len(part),), len(masks)).scatter_reduce(0, ray, against[cells], "amin")
        plausible = (against[cells] == least[ray]) & (least[ray] <= MOST_WRONG * len(masks))
        found[tuple(along[plausible] for along in cells)] = True
    return found


def _cells_along(
    rays: Rays, space: Space, left: Bool[Tensor, "X Y Z"]
) -> tuple[Int[Tensor, "M"], tuple[Int[Tensor, "M"], ...]]:
    """Of each sample its ray and its cell."""
    samples = samples_of(rays, replace(space, box=space.box.cpu(), occupied_box=space.box.cpu()))
    counts = torch.tensor(left.shape)
    return samples.ray, torch.minimum((samples.places * counts).long().clamp_min(0), counts - 1).unbind(-1)


def limit_of(box: Float[Tensor, "2 3"], left: Bool[Tensor, "X Y Z"]) -> Carving:
    """Beyond which no look at empty space may go: what carving left and a cell more around it, since masks err."""
    return Carving(box, widened(left))
