"""Density and appearance as factored grids (TensoRF, Chen et al. 2022, sections 3 and 4)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.kernel_limits import VOLUME_COMPONENT_LANES
from ringlight.fields.networks import fan_in_uniform
from ringlight.volume.contract import Sides
from ringlight.volume.factored_source import FactoredSource
from ringlight.volume.factors import Decomposition, Factors
from ringlight.volume.grids import sides_of
from ringlight.volume.shading import FeatureShading


class FactoredField(nn.Module):
    """Density is the sum of its components; appearance is ``basis`` [F C] times its own, without a bias."""

    def __init__(
        self,
        kind: Decomposition,
        sides: Sides,
        components: tuple[int, int],
        features: int,
        generator: torch.Generator,
    ):
        super().__init__()
        self._made = (kind, components, features)
        self.density_factors = Factors(kind, sides, components[0], generator)
        self.appearance_factors = Factors(kind, sides, components[1], generator)
        joined = self.appearance_factors.width
        self.basis = fan_in_uniform((features, joined), joined, generator)

    @property
    def sides(self) -> Sides:
        """Nodes along x, y and z."""
        return self.density_factors.sides

    @property
    def intervals(self) -> Sides:
        """The last node lies on the box."""
        x, y, z = self.sides
        return x - 1, y - 1, z - 1

    def density(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        total: Tensor = self.density_factors(points).sum(-1)
        return total

    def appearance(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N F"]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        mixed: Tensor = self.appearance_factors(points) @ self.basis.T
        return mixed

    def kernels(self, shading: FeatureShading) -> FactoredSource | None:
        """See :class:`ringlight.volume.contract.VolumeField`; of components that fill vectors."""
        both = (self.density_factors, self.appearance_factors)
        fill = all(each.components % VOLUME_COMPONENT_LANES == 0 for each in both)
        return FactoredSource(self, shading) if fill else None

    def outline(self, sides: Sides) -> dict[str, Tensor]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        kind, components, features = self._made
        return dict(FactoredField(kind, sides, components, features, torch.Generator()).named_parameters())

    def fitting(self, box: Float[Tensor, "2 3"], voxels: float) -> Sides:
        """Cubes."""
        return sides_of(box, voxels)

    def resize(self, sides: Sides) -> None:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        self.density_factors.resize(sides)
        self.appearance_factors.resize(sides)

    def cuttable(self, first: Sides, last: Sides) -> tuple[Sides, Sides]:
        """These nodes."""
        return first, last

    def crop(self, first: Sides, last: Sides) -> None:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        self.density_factors.crop(first, last)
        self.appearance_factors.crop(first, last)
