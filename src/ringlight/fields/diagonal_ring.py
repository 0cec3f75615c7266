"""The diagonal ring: the canonical polyadic decomposition (Carroll and Chang 1970) with neural factors.

    a_c(x, y, z, v) = sum_d h_x(x)_d h_y(y)_d h_z(z)_d h_v(v)_d g_cd

A tensor ring whose matrices are diagonal. With D = R^2 components its heads, and the numbers it holds, are those of the
full ring of rank R: what differs is only that the components of one coordinate do not mix with those of the next.
"""

import torch
from torch import nn

from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.tensor_ring import TensorRing


class DiagonalRing(TensorRing):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``.

    A free ``core`` is [C D], D = R^2.
    """

    diagonal = True

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__(settings, generator)
        if self.channels is None:
            self.core = nn.Parameter(self.core.detach().flatten(1))
