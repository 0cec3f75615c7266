"""The neural tensor ring (RingLight-GS, eq. 7): features of a point and a direction as the trace of five matrices.

    a_c(x, y, z, v) = Trace(H_x(x) H_y(y) H_z(z) H_v(v) G_c)

The heads H are networks (``heads``), the channel core G is free. Nothing here knows what the features are for.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.directions import octahedral_from_directions
from ringlight.fields.heads import AxisHeads, DirectionHead
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.tables import between_map_nodes, between_nodes


@dataclass(frozen=True)
class RingTables:
    """The heads at their nodes, and the channel core as the linear map that follows the product.

    ``axes`` row k of axis d is H_d at node k; ``view`` row j * side + i is H_v at node (i, j) of the octahedral
    map; ``core`` row c is the transpose of G_c, rows first, so that a = core . vec(H_x H_y H_z H_v). D = R^2.
    """

    axes: Float[Tensor, "3 K D"]
    view: Float[Tensor, "V D"]
    core: Float[Tensor, "C D"]


class TensorRing(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions."""

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__()
        rank = settings.rank
        self.axes = AxisHeads(settings, generator)
        self.view = DirectionHead(settings, generator)
        core = torch.empty(settings.features, rank, rank).normal_(0, settings.core_scale, generator=generator)
        self.core = nn.Parameter(core)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        """Every head run at every point: slow, and the limit of :meth:`tabulated` for many nodes."""
        x, y, z = self.axes(points).unbind()
        return self._contracted(x, y, z, self.view(directions), self._linear_core())

    def tables(self) -> RingTables:
        """The heads at their nodes; differentiable, so that gradients reach the heads through the tables."""
        return RingTables(self.axes.table(), self.view.table(), self._linear_core())

    def tabulated(
        self,
        points: Float[Tensor, "N 3"],
        directions: Float[Tensor, "N 3"],
        tables: RingTables | None = None,
    ) -> Float[Tensor, "N C"]:
        """The heads interpolated between their nodes; ``tables`` made earlier by :meth:`tables` are reused."""
        tables = tables or self.tables()
        x, y, z = (between_nodes(table, at) for table, at in zip(tables.axes, points.unbind(-1), strict=True))
        view = between_map_nodes(tables.view, octahedral_from_directions(directions))
        return self._contracted(x, y, z, view, tables.core)

    def _linear_core(self) -> Float[Tensor, "C D"]:
        return self.core.transpose(1, 2).flatten(1)

    def _contracted(
        self,
        x: Float[Tensor, "N D"],
        y: Float[Tensor, "N D"],
        z: Float[Tensor, "N D"],
        view: Float[Tensor, "N D"],
        core: Float[Tensor, "C D"],
    ) -> Float[Tensor, "N C"]:
        rank = self.core.shape[-1]
        x, y, z, view = (matrix.unflatten(-1, (rank, rank)) for matrix in (x, y, z, view))
        return (x @ y @ z @ view).flatten(1) @ core.T
