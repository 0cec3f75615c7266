"""The tensor ring with discrete cores (Zhao et al. 2016): free matrices at knots, linear in between.

What the paper's ablation calls "w/o neural module": the classical decomposition of a grid, whose slices are learned
one by one, without networks that tie neighbours together.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.want import Want
from ringlight.fields.heads import AXES
from ringlight.fields.octahedral import sewn
from ringlight.fields.ring_settings import KnotSettings, RingSettings
from ringlight.fields.ring_tables import RingTables, core_gradient, linear_core, ring_features, way_back


class DiscreteRing(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``.

    ``axes`` [3 K D] holds H_x, H_y, H_z at K knots, rows first, D = R^2; ``view`` [side side D] holds H_v at the knots
    of the octahedral map, row j for its second axis; ``core`` [C R R] is the channel core. All start as normal noise of
    the channel core's scale, as TensoRF's and PuTT's cores do (0.1). There is nothing to tabulate: exact and tabulated
    features are the same.
    """

    def __init__(self, settings: RingSettings, knots: KnotSettings, generator: torch.Generator):
        super().__init__()
        rank = settings.rank

        def noise(*shape: int) -> nn.Parameter:
            return nn.Parameter(torch.empty(shape).normal_(0, settings.core_scale, generator=generator))

        self.axes = noise(AXES, knots.axis, rank**2)
        self.view = noise(knots.view, knots.view, rank**2)
        self.core = noise(settings.features, rank, rank)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        return ring_features(self.differentiable_tables(), points, directions)

    def tables(self, want: Want) -> RingTables:
        """The cores themselves; directions that the octahedral square shows twice get one matrix."""
        with torch.no_grad():
            tables = self.differentiable_tables()
        return replace(tables, backward=way_back(want, self._gradients))

    def _gradients(self, grad_tables: RingTables) -> dict[str, Tensor]:
        with torch.enable_grad():
            view = sewn(self.view).flatten(0, 1)
        (grad_view,) = torch.autograd.grad(view, self.view, grad_tables.view)
        return {"axes": grad_tables.axes, "view": grad_view, "core": core_gradient(grad_tables.core)}

    def differentiable_tables(self) -> RingTables:
        """The cores with torch's graph."""
        return RingTables(self.axes, sewn(self.view).flatten(0, 1), linear_core(self.core))
