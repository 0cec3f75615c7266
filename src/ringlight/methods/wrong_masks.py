"""Masks that contradict each other: what one of them carves of the subject comes back.

A wrong mask carves what all others need, and what is carved is never learned. Its trace are rays of the subject that
meet nothing any more.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.scene import Scene, View
from ringlight.core.stages import counted
from ringlight.data.hull import Mask, has_outside
from ringlight.data.rays import RayBatches, Rays
from ringlight.errors import DoubtWarning
from ringlight.methods.volume_box import volume_box
from ringlight.methods.volume_carving import places_asked
from ringlight.volume.looked_for import AT_ONCE
from ringlight.volume.marching import Space, samples_of
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import everything

FEWEST = 2
"""Masks that must have a cell outside for it to be carved, where masks are not all right."""

MOST_WRONG = 0.25
"""Share of the masks that may be wrong about a place. Where more of them have all of a ray outside the subject, it is
the mask of the ray's own photograph that is."""

MOST_LOST = 1 << 18
"""Rays that are followed, evenly chosen where more meet nothing: neighbours go through the same cells."""

SAME = 1e-5
"""Of a box's longest side: what writing numbers down, and reading them, may move its corners by."""


def mended(
    left: Bool[Tensor, "X Y Z"],
    met: Bool[Tensor, "P"],
    model: VolumeModel,
    masks: Sequence[Mask],
    scene: Scene,
    batches: RayBatches,
) -> Bool[Tensor, "X Y Z"] | None:
    """What the masks leave of ``model``'s box once those that are wrong have less to say; None where none seem to be.

    ``met`` says which of all rays meet what is ``left`` now. A box that is not that of the masks may cut the subject
    off, so that rays of it meet nothing in any case. Warns with :class:`ringlight.errors.DoubtWarning`.
    """
    subject = batches.shows_subject()
    lost = (subject & ~met).nonzero()[:, 0]
    box = model.box.cpu()
    if not len(lost):
        return None
    if not torch.allclose(volume_box(scene).box, box, rtol=0, atol=SAME * float((box[1] - box[0]).max())):
        return None
    found = _given_back(left, model, masks, lost, batches.through)
    share = len(lost) / int(subject.sum())
    warnings.warn(DoubtWarning(_in_words(found & ~left, box, masks, scene.train, share)), stacklevel=2)
    return found


def _given_back(
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
    places, outside = places_asked((x, y, z), masks, box)
    against = torch.zeros(left.shape, dtype=torch.long)
    for mask in counted("asking which masks are wrong", masks):
        against += has_outside(mask, places, outside).view(left.shape)
    found = left | (against < FEWEST)
    for part in lost.split(AT_ONCE):
        ray, cells = _cells_along(through(part), space, left)
        least = torch.full((len(part),), len(masks)).scatter_reduce(0, ray, against[cells], "amin")
        plausible = (against[cells] == least[ray]) & (least[ray] <= MOST_WRONG * len(masks))
        found[tuple(along[plausible] for along in cells)] = True
    return found


def _in_words(
    given: Bool[Tensor, "X Y Z"], box: Float[Tensor, "2 3"], masks: Sequence[Mask], views: Sequence[View], lost: float
) -> str:
    """On the cells of ``box`` that come back, for the share ``lost`` of the subject's rays."""
    x, y, z = given.shape
    places, outside = places_asked((x, y, z), masks, box)
    against = [int(has_outside(mask, places[given.flatten()], outside).sum()) for mask in masks]
    wrong = masks[max(range(len(masks)), key=against.__getitem__)].camera
    name = next((view.name for view in views if view.camera is wrong), "one photograph")
    return (
        f"masks contradict each other: {lost:.2%} of the pixels that show the subject see nothing that all masks "
        f"leave, most of all for what that of {name} leaves out. What fewer than {FEWEST} leave out comes back, and "
        "more on the way of these pixels; see that mask, or learn without carving by --no-carve"
    )


def _cells_along(
    rays: Rays, space: Space, left: Bool[Tensor, "X Y Z"]
) -> tuple[Int[Tensor, "M"], tuple[Int[Tensor, "M"], ...]]:
    """Of each sample its ray and its cell."""
    samples = samples_of(rays, replace(space, box=space.box.cpu(), occupied_box=space.box.cpu()))
    counts = torch.tensor(left.shape)
    return samples.ray, torch.minimum((samples.places * counts).long().clamp_min(0), counts - 1).unbind(-1)
