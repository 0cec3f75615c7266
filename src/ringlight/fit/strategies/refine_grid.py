"""Volumes begin coarse: at some steps the grid gets a finer resolution, and Adam begins anew (TensoRF, section 4.3)."""

from collections.abc import Mapping

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.stateless import Stateless
from ringlight.volume.model import VolumeModel


class RefineGrid(Stateless):
    """After step s the grid has about ``voxels[s]`` voxels of its box; what is learned is interpolated."""

    def __init__(self, voxels: Mapping[int, float]):
        self.voxels = dict(voxels)

    def update(self, step: int, model: VolumeModel, optimizer: Optimizer, prediction: Rendering) -> None:
        """See :class:`ringlight.fit.strategies.contract.Strategy`."""
        if step in self.voxels:
            model.refine(self.voxels[step])
            optimizer.begin_anew()
