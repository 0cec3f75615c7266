"""The diagonal ring: the canonical polyadic decomposition (Carroll and Chang 1970) with neural factors.

    a_c(x, y, z, v) = sum_d h_x(x)_d h_y(y)_d h_z(z)_d h_v(v)_d g_cd

A tensor ring whose matrices are diagonal. With D = R^2 components its heads, and the numbers it holds, are those of the
full ring of rank R: what differs is only that the components of one coordinate do not mix with those of the next.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.want import Want
from ringlight.fields.heads import AxisHeads, DirectionHead, head_names
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.ring_tables import RingTables, way_back


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

    def tables(self, want: Want) -> RingTables:
        """The heads at their nodes."""
        backward = way_back(want, self._gradients)
        return RingTables(self.axes.table(), self.view.table(), self.core.detach(), diagonal=True, backward=backward)

    def _gradients(self, grad_tables: RingTables) -> dict[str, Tensor]:
        axes, view = self.axes.gradients(grad_tables.axes), self.view.gradients(grad_tables.view)
        return head_names(axes=axes, view=view) | {"core": grad_tables.core}

    def differentiable_tables(self) -> RingTables:
        """The same by torch."""
        axes, view = self.axes.differentiable_table(), self.view.differentiable_table()
        return RingTables(axes, view, self.core, diagonal=True)
