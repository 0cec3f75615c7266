"""The diagonal ring: the canonical polyadic decomposition (Carroll and Chang 1970) with neural factors.

    a_c(x, y, z, v) = sum_d h_x(x)_d h_y(y)_d h_z(z)_d h_v(v)_d g_cd

A tensor ring whose matrices are diagonal. With D = R^2 components its heads, and the numbers it holds, are those of the
full ring of rank R: what differs is only that the components of one coordinate do not mix with those of the next.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.fields.heads import AxisHeads, DirectionHead
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.ring_tables import RingTables, ring_features


class DiagonalRing(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``. ``core`` is [C D], D = R^2."""

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__()
        self.axes = AxisHeads(settings, generator)
        self.view = DirectionHead(settings, generator)
        core = torch.empty(settings.features, settings.rank**2).normal_(0, settings.core_scale, generator=generator)
        self.core = nn.Parameter(core)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        x, y, z = self.axes(points).unbind()
        return (x * y * z * self.view(directions)) @ self.core.T

    def tables(self) -> RingTables:
        """The heads at their nodes; differentiable, so that gradients reach the heads through the tables."""
        return RingTables(self.axes.table(), self.view.table(), self.core, diagonal=True)

    def gradients(self, by_tables: RingTables) -> dict[str, Tensor]:
        """By parameter name, from those of :meth:`tables`, without autograd: where its kernels apply."""
        axes, view = self.axes.gradients(by_tables.axes), self.view.gradients(by_tables.view)
        named = {f"axes.{name}": gradient for name, gradient in axes.items()}
        return named | {f"view.{name}": gradient for name, gradient in view.items()} | {"core": by_tables.core}

    def tabulated(
        self,
        points: Float[Tensor, "N 3"],
        directions: Float[Tensor, "N 3"],
        tables: RingTables | None = None,
    ) -> Float[Tensor, "N C"]:
        """The heads interpolated between their nodes; ``tables`` made earlier by :meth:`tables` are reused."""
        return ring_features(tables or self.tables(), points, directions)
