"""Factors of a point, one for each of F features: products of what three axes hold at its coordinates.

    f_k(p, r) = x_k(p_x) y_k(p_y) z_k(p_z) v_k(r)

With features v of a direction this is a diagonal tensor ring (the canonical polyadic form, Carroll and Chang 1970;
``diagonal_ring.py``) with discrete cores (Zhao et al. 2016; ``discrete_ring.py``), whose direction's part may be of
any kind, such as octahedral maps of several resolutions.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.fields.heads import AXES
from ringlight.fields.tables import between_nodes


class AxisFactors(nn.Module):
    """``axes`` [3 K F]: factors at K nodes on [-1, 1] of x, y and z, linear in between.

    All are one at the start, so that features begin as the direction's alone.
    """

    def __init__(self, nodes: int, features: int):
        super().__init__()
        self.axes = nn.Parameter(torch.ones(AXES, nodes, features))

    def forward(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N F"]:
        """The products; beyond [-1, 1] an axis is as at its end."""
        x, y, z = (between_nodes(table, at) for table, at in zip(self.axes, points.unbind(-1), strict=True))
        return x * y * z
