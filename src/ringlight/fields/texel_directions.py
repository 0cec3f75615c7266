"""Where a cubemap's texels lie on the unit sphere, and how much of it each takes."""

from functools import lru_cache

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from ringlight.fields.cubemap import FACES, OTHERS


@lru_cache(maxsize=16)
def texel_directions(side: int) -> Float[Tensor, "T 3"]:
    """Unit directions of the centres, face by face and row by row; float64."""
    along = (torch.arange(side, dtype=torch.float64) + 0.5) / side * 2 - 1
    found = torch.empty(FACES, side, side, 3, dtype=torch.float64)
    for face in range(FACES):
        across, down = OTHERS[face // 2]
        found[face, ..., face // 2] = 1.0 - 2 * (face % 2)
        found[face, ..., across] = along[None, :]
        found[face, ..., down] = along[:, None]
    return torch.nn.functional.normalize(found.flatten(0, 2), dim=-1)


@lru_cache(maxsize=16)
def solid_angles(side: int) -> Float[Tensor, "T"]:
    """Of each texel, steradians, exact; float64.

    The rectangle from the middle of a face to (x, y) takes atan(x y / sqrt(1 + x^2 + y^2)).
    """
    edges = torch.linspace(-1, 1, side + 1, dtype=torch.float64)
    x, y = edges[:, None], edges[None, :]
    corner = torch.atan2(x * y, (1 + x * x + y * y).sqrt())
    face = corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]
    return face.flatten().repeat(FACES)


@lru_cache(maxsize=16)
def children(side: int) -> Int64[Tensor, "T 4"]:
    """The four texels of a cubemap of twice the ``side`` that lie in each texel."""
    numbers = torch.arange(FACES * 4 * side * side).view(FACES, side, 2, side, 2)
    return numbers.permute(0, 1, 3, 2, 4).reshape(-1, 4)
