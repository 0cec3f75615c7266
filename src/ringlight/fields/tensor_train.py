"""The open ring: a tensor train (Oseledets 2011) with neural cores, whose first and last rank are one.

    a_c(x, y, z, v) = h_x(x)^T H_y(y) H_z(z) H_v(v) g_c

The ring with one row of H_x and one column of G_c only: no path leads from the last core back to the first.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.want import Want
from ringlight.fields.heads import AXES, AxisHeads, ChannelHead, DirectionHead, head_names
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.ring_tables import RingTables, contracted, way_back


class TensorTrain(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``. A free ``core`` is [C R].

    As tables it is a ring with zeros in all other rows and columns, so the ring's kernel serves it.
    """

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__()
        self.first = AxisHeads(settings, generator, 1, settings.rank)
        self.middle = AxisHeads(settings, generator, AXES - 1)
        self.view = DirectionHead(settings, generator)
        self.rank = settings.rank
        self.channels: ChannelHead | None = None
        if settings.core == "network":
            self.channels = ChannelHead(settings, generator, settings.rank)
            return
        core = torch.empty(settings.features, settings.rank).normal_(0, settings.core_scale, generator=generator)
        self.core = nn.Parameter(core)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        x = self._first_row(self.first(points[:, :1]))[0]
        y, z = self.middle(points[:, 1:]).unbind()
        return contracted(x, y, z, self.view(directions), self._first_row(self._cores()))

    def tables(self, want: Want) -> RingTables:
        """The heads at their nodes."""
        axes = torch.cat([self._first_row(self.first.table()), self.middle.table()])
        backward = way_back(want, self._gradients)
        core = self.core.detach() if self.channels is None else self.channels.cores()
        return RingTables(axes, self.view.table(), self._first_row(core), backward=backward)

    def _gradients(self, grad_tables: RingTables) -> dict[str, Tensor]:
        rank = self.rank
        first = self.first.gradients(grad_tables.axes[:1, :, :rank])
        middle, view = self.middle.gradients(grad_tables.axes[1:]), self.view.gradients(grad_tables.view)
        named, core = head_names(first=first, middle=middle, view=view), grad_tables.core[:, :rank].contiguous()
        if self.channels is None:
            return named | {"core": core}
        return named | head_names(channels=self.channels.gradients(core[None]))

    def differentiable_tables(self) -> RingTables:
        """The same by torch."""
        axes = torch.cat([self._first_row(self.first.differentiable_table()), self.middle.differentiable_table()])
        return RingTables(axes, self.view.differentiable_table(), self._first_row(self._cores()))

    def _first_row(self, vectors: Float[Tensor, "*rows R"]) -> Float[Tensor, "*rows D"]:
        """R x R matrices, rows first, with the vectors as their first row; the transpose of the first column of G_c."""
        return nn.functional.pad(vectors, (0, self.rank * self.rank - self.rank))

    def _cores(self) -> Float[Tensor, "C R"]:
        return self.core if self.channels is None else self.channels.differentiable_cores()
