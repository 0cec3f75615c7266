"""The neural tensor ring (RingLight-GS, eq. 7): features of a point and a direction as the trace of five matrices.

    a_c(x, y, z, v) = Trace(H_x(x) H_y(y) H_z(z) H_v(v) G_c)

The heads H are networks (``heads``); the channel core G is free, or a network of the channel's place. Nothing here
knows what the features are for.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.want import Want
from ringlight.fields.heads import AxisHeads, ChannelHead, DirectionHead, head_names
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.ring_tables import RingTables, contracted, core_gradient, linear_core, way_back


class TensorRing(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``. A free ``core`` is [C R R]."""

    diagonal = False

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__()
        rank = settings.rank
        self.axes = AxisHeads(settings, generator)
        self.view = DirectionHead(settings, generator)
        self.channels: ChannelHead | None = None
        if settings.core == "network":
            self.channels = ChannelHead(settings, generator, rank**2)
            return
        core = torch.empty(settings.features, rank, rank).normal_(0, settings.core_scale, generator=generator)
        self.core = nn.Parameter(core)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        """Every head run at every point: slow, and the limit of its tables for many nodes."""
        x, y, z = self.axes(points).unbind()
        return contracted(x, y, z, self.view(directions), self._linear_core(), self.diagonal)

    def tables(self, want: Want) -> RingTables:
        """The heads at their nodes."""
        axes, view = self.axes.table(), self.view.table()
        core = self._linear_core().detach() if self.channels is None else self._linear(self.channels.cores())
        return RingTables(axes, view, core, self.diagonal, way_back(want, self._gradients))

    def _gradients(self, grad_tables: RingTables) -> dict[str, Tensor]:
        axes, view = self.axes.gradients(grad_tables.axes), self.view.gradients(grad_tables.view)
        core = grad_tables.core if self.diagonal else core_gradient(grad_tables.core)
        if self.channels is None:
            return head_names(axes=axes, view=view) | {"core": core}
        return head_names(axes=axes, view=view, channels=self.channels.gradients(core.flatten(1)[None]))

    def differentiable_tables(self) -> RingTables:
        """The same by torch."""
        axes, view = self.axes.differentiable_table(), self.view.differentiable_table()
        return RingTables(axes, view, self._linear_core(), self.diagonal)

    def _linear_core(self) -> Float[Tensor, "C D"]:
        return self._linear(self.core.flatten(1) if self.channels is None else self.channels.differentiable_cores())

    def _linear(self, cores: Float[Tensor, "C D"]) -> Float[Tensor, "C D"]:
        """Cores, rows first, as the map that follows the product."""
        rank = round(cores.shape[1] ** 0.5)
        return cores if self.diagonal else linear_core(cores.unflatten(1, (rank, rank)))
