"""A volume learns which of its cells are empty: rays skip them, and its box is cut to the others (TensoRF, Chen et al.
2022, section 4.3)."""

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.volume.grids import nodes_around
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import Carving, box_of, cells_of, centers, unpacked, widened

EMPTY = 1e-4
"""Opacity of one step, without the distance scale, below which a cell is empty (TensoRF)."""

PLACES_AT_ONCE = 1 << 18
"""Of which density is asked together."""


@torch.no_grad()
def find_empty(model: VolumeModel, carving: Carving | None = None) -> Float[Tensor, "2 3"]:
    """See which cells of its box are empty now, and skip them from now on, with those that were but for a layer around
    the others, and with all that meet nothing of what ``carving`` leaves.

    Returns the box of the others, world units; the whole box where all are empty.
    """
    cells = cells_of(model.box, max(model.nodes))
    step = model.space().step / model.unit.item()
    places = centers(cells).to(model.box)
    thickness = [step * model.density_values(part) for part in places.split(PLACES_AT_ONCE)]
    full = (-torch.expm1(-torch.cat(thickness)) >= EMPTY).view(cells)
    wide = widened(full)
    if carving is not None:
        # The layer would grow beyond it, where too few rays are drawn to clear its fog.
        wide &= carving.met_by(model.box, cells).to(wide.device)
    if not wide.any():
        return model.box.clone()
    model.skip_all_but(wide)
    return box_of(wide, model.box)


@torch.no_grad()
def skip_less(model: VolumeModel, lots: Iterable[Float[Tensor, "N 3"]], carving: Carving) -> Float[Tensor, "2 3"]:
    """Cells around these places, of the box's [0, 1]^3, are not empty after all, but for what ``carving`` does not
    leave. Of the cells that the last :func:`find_empty` looked at; returns the box of all that are not empty."""
    occupied = unpacked(model.occupied)
    x, y, z = occupied.shape
    back, counts = torch.zeros_like(occupied), torch.tensor((x, y, z), device=model.device)
    for places in lots:
        back[torch.minimum((places * counts).long().clamp_min(0), counts - 1).unbind(-1)] = True
    occupied |= widened(back) & carving.met_by(model.box, (x, y, z)).to(back.device)
    model.skip_all_but(occupied)
    return box_of(occupied, model.box)


@torch.no_grad()
def shrink(model: VolumeModel, box: Float[Tensor, "2 3"]) -> bool:
    """Cut the model's grid to the nodes around ``box``, world units; returns whether any were cut off."""
    low, high = model.box
    nodes, intervals = model.nodes, torch.tensor(model.intervals).to(model.box)
    around = nodes_around(model.box, box, nodes, intervals)
    first, final = model.field.cuttable(*((x, y, z) for x, y, z in around.tolist()))
    if first == (0, 0, 0) and final == tuple(side - 1 for side in nodes):
        return False
    model.field.crop(first, final)
    model.box = low + torch.tensor([first, final]).to(model.box) / intervals * (high - low)
    return True
