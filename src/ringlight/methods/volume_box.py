"""The box that a volume covers: what the masks leave, or what the scene's loader found."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.scene import Scene
from ringlight.data.hull import COARSE_CELLS, Mask, VoxelGrid, depths_inside, masks_of
from ringlight.data.points import FEWEST_FOR_BOX
from ringlight.data.surface import guessed_masks

MARGIN = 0.03
"""Of its longest side, added to a box of masks on each side: a coarse hull is off by less than a cell."""


FEW_VIEWS = 0.1
"""Share of the views that must see what belongs into a box of masks. Photographs may cut the subject, so most of them
need not see its ends; what next to none see no mask has carved either."""


class ChosenBox(NamedTuple):
    """World units, and where it is from, in a few words."""

    box: Float[Tensor, "2 3"]
    source: str


def subject_masks(scene: Scene) -> tuple[list[Mask], str]:
    """Masks of the photographs, or of their even background, and which of these; none where they have neither."""
    masks = masks_of(scene.train)
    return (masks, "the masks") if masks else (guessed_masks(scene), "the even background")


def volume_box(scene: Scene) -> ChosenBox:
    """The box of what masks, or an even background, leave where photographs have these; else the scene's."""
    masks, source = subject_masks(scene)
    if masks:
        grid = VoxelGrid.over(scene.box, COARSE_CELLS)
        box = grid.bounds(depths_inside(grid.centers(), masks, grid.pitch, FEW_VIEWS) > -grid.pitch)
        if box is not None:
            margin = MARGIN * (box[1] - box[0]).max()
            low, high = (box[0] - margin).maximum(scene.box[0]), (box[1] + margin).minimum(scene.box[1])
            return ChosenBox(torch.stack([low, high]), source)
    by_points = scene.points.measured and len(scene.points.positions) >= FEWEST_FOR_BOX
    return ChosenBox(scene.box, "the points" if by_points else "the cameras")


def in_words(chosen: ChosenBox) -> str:
    """The decision, in a sentence."""
    low, high = (", ".join(f"{value:.3g}" for value in corner) for corner in chosen.box.tolist())
    return f"the volume's box is that of {chosen.source}: ({low}) to ({high}); --bounds sets another"
