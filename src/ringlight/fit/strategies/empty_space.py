"""Volumes learn what is empty: at some steps cells are looked at, the box shrinks, rays that meet nothing are left out.

TensoRF (Chen et al. 2022), section 4.3 and its supplement.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.data.rays import RayBatches
from ringlight.fit.optimizer import Optimizer
from ringlight.volume.emptying import find_empty, shrink, skip_less
from ringlight.volume.looked_for import AT_ONCE
from ringlight.volume.marching import samples_of
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import BITS, Carving, packed, unpacked


class EmptySpace:
    """After each of ``steps`` empty cells are found, with all that ``carving`` does not leave. After the first the grid
    is cut to the box of the others, and Adam begins anew; after the second only rays that meet one of the others are
    drawn.

    Where there is a ``carving``, cells along rays of the subject that would meet nothing any more are left as they
    were: what is not learned yet looks empty, and what rays skip is never learned.
    """

    most = None

    def __init__(self, batches: RayBatches, steps: tuple[int, ...], carving: Carving | None = None):
        self.batches, self.steps, self.carving = batches, steps, carving
        self._kept: Tensor = torch.zeros(0, dtype=torch.uint8)

    def update(self, step: int, model: VolumeModel, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step not in self.steps:
            return
        before = model.space()
        box = find_empty(model, self.carving)
        # Where all is empty it found nothing, and the cells may be of an older box.
        if self.carving is not None and model.occupied is not before.occupied:
            lost = (self.batches.shows_subject() & ~self.batches.looked_at(model.meets_something)).nonzero()[:, 0]
            if len(lost):
                rays = (self.batches.through(part).to(model.device) for part in lost.split(AT_ONCE))
                box = skip_less(model, (samples_of(part, before).places for part in rays), self.carving)
        if step == self.steps[0] and shrink(model, box):
            optimizer.begin_anew()
        if step == self.steps[-1] and len(self.steps) > 1:
            self._filter(model)

    def _filter(self, model: VolumeModel) -> None:
        chosen = self.batches.looked_at(model.meets_something)
        if chosen.any():
            self.batches.keep(chosen)
            self._kept = packed(torch.nn.functional.pad(chosen, (0, -len(chosen) % BITS)))

    def state(self) -> dict[str, Tensor]:
        """Bits of the rays that are drawn; none before they are chosen."""
        return {"kept": self._kept}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        kept, rays = state["kept"].clone(), self.batches.all_rays
        if len(kept):
            chosen = unpacked(kept)
            if len(chosen) != -(-rays // BITS) * BITS or not chosen[:rays].any():
                raise ValueError(f"{len(chosen):,} bits say which of {rays:,} rays are drawn, {int(chosen.sum()):,} do")
            self.batches.keep(chosen[:rays])
        self._kept = kept
