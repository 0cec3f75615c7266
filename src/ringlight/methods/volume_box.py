"""The box that a volume covers: what the masks leave, or what the scene's loader found."""

from collections.abc import Sequence
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from ringlight.core.scene import Scene
from ringlight.data.hull import COARSE_CELLS, FINE_CELLS, Mask, VoxelGrid, depths_inside, masks_of
from ringlight.data.points import FEWEST_FOR_BOX
from ringlight.data.surface import guessed_masks
from ringlight.methods.volume_carving import reach

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
        coarse = _left_by(masks, scene.box, COARSE_CELLS)
        if coarse is not None:
            # Nodes in empty space are lost to a grid that is never cut.
            fine = _left_by(masks, coarse, FINE_CELLS)
            return ChosenBox(coarse if fine is None else fine, source)
    by_points = scene.points.measured and len(scene.points.positions) >= FEWEST_FOR_BOX
    return ChosenBox(scene.box, "the points" if by_points else "the cameras")


def _left_by(masks: Sequence[Mask], box: Float[Tensor, "2 3"], cells: int) -> Float[Tensor, "2 3"] | None:
    """The box of the voxels within ``box``, so many along its longest side, that no mask has by more than
    :func:`reach` outside the subject; None where there are none."""
    grid = VoxelGrid.over(box, cells)
    outside = reach(masks, box, grid.pitch)
    found = grid.bounds(depths_inside(grid.centers(), masks, outside, FEW_VIEWS) > -outside, more=0)
    return None if found is None else found.maximum(box[0]).minimum(box[1])


def in_words(chosen: ChosenBox) -> str:
    """The decision, in a sentence."""
    low, high = (", ".join(f"{value:.3g}" for value in corner) for corner in chosen.box.tolist())
    return f"the volume's box is that of {chosen.source}: ({low}) to ({high}); --bounds sets another"
