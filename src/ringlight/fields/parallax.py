"""Where a ray leaves a sphere: reflections of near things as a function of direction alone.

An environment map holds what is infinitely far away. Its parallax correction (Lagarde and Zanuttini, 2012) looks up the
direction, seen from the centre, of the point where the ray meets a proxy; here the proxy is a sphere whose centre and
size are learned.
"""

import torch
from jaxtyping import Float
from torch import Tensor

# A ray that passes by has no exit; the point where it is nearest is taken. The bound keeps the root's slope finite.
SMALLEST_HALF_CHORD_SQUARED = 1e-6


def sphere_exits(
    points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"], sphere: Float[Tensor, "4"]
) -> Float[Tensor, "N 3"]:
    """From the sphere's centre to where unit rays leave it, in units of its radius.

    ``sphere`` is the centre, in the units of the points, and the logarithm of the inverse radius.
    """
    local = (points - sphere[:3]) * sphere[3].exp()
    along = (local * directions).sum(-1, keepdim=True)
    half_chord_squared = along * along - (local * local).sum(-1, keepdim=True) + 1
    distance = half_chord_squared.clamp_min(SMALLEST_HALF_CHORD_SQUARED).sqrt() - along
    return torch.addcmul(local, distance, directions)
