"""A volume's field that ringlight has not: a grid of five numbers at each node, interpolated by torch."""

import torch
import torch.nn.functional
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.volume.contract import Sides
from ringlight.volume.grids import sides_of
from ringlight.volume.shading import FeatureShading

FEATURES = 4


class DenseField(nn.Module):
    """``nodes`` [X Y Z 1 + F]: density, and features."""

    def __init__(self, sides: Sides, generator: torch.Generator):
        super().__init__()
        self.nodes = nn.Parameter(torch.randn(*sides, 1 + FEATURES, generator=generator))

    @property
    def sides(self) -> Sides:
        x, y, z, _ = self.nodes.shape
        return x, y, z

    @property
    def intervals(self) -> Sides:
        x, y, z = self.sides
        return x - 1, y - 1, z - 1

    def density(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        return self._at(points)[:, 0]

    def appearance(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N F"]:
        return self._at(points)[:, 1:]

    def kernels(self, shading: FeatureShading) -> None:
        """None."""

    def outline(self, sides: Sides) -> dict[str, Tensor]:
        return dict(DenseField(sides, torch.Generator()).named_parameters())

    def fitting(self, box: Float[Tensor, "2 3"], voxels: float) -> Sides:
        return sides_of(box, voxels)

    @torch.no_grad()
    def resize(self, sides: Sides) -> None:
        grid = self.nodes.permute(3, 0, 1, 2)[None]
        finer = torch.nn.functional.interpolate(grid, sides, mode="trilinear", align_corners=True)
        self.nodes = nn.Parameter(finer[0].permute(1, 2, 3, 0).contiguous())

    def cuttable(self, first: Sides, last: Sides) -> tuple[Sides, Sides]:
        return first, last

    @torch.no_grad()
    def crop(self, first: Sides, last: Sides) -> None:
        x, y, z = (slice(low, high + 1) for low, high in zip(first, last, strict=True))
        self.nodes = nn.Parameter(self.nodes[x, y, z].clone())

    def _at(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        grid = self.nodes.permute(3, 2, 1, 0)[None]  # grid_sample takes x as the last axis
        found = torch.nn.functional.grid_sample(grid, 2 * points[None, None, None] - 1, align_corners=True)
        return found[0, :, 0, 0].T
