"""Cubemaps: numbers by direction on six square faces, linear between texels and without a seam.

Face 2a is that of the positive axis a, 2a + 1 that of the negative one. A direction's place on it are its two other
coordinates, in their order, over the length of its coordinate a: columns go with the first, rows with the second.
"""

from functools import lru_cache
from itertools import product

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from ringlight.core.directions import SMALLEST_LENGTH

FACES = 6

OTHERS = ((1, 2), (0, 2), (0, 1))
"""The axes across each axis' faces: along columns, along rows."""

MEETING = 3
"""Faces that meet at a corner."""


def bordered(faces: Float[Tensor, "6 S S C"]) -> Float[Tensor, "6 S+2 S+2 C"]:
    """Each face with the texels around it, so that four neighbours are at hand wherever a direction falls.

    A texel beyond an edge is that of the face which meets there. Beyond a corner three meet, and their mean stands
    there: each of the three faces then shows the mean of the three at the very corner.
    """
    side = faces.shape[1]
    places, sources = (table.to(faces.device) for table in border(side))
    around = faces.flatten(0, 2)[sources].mean(1)
    padded = torch.nn.functional.pad(faces, (0, 0, 1, 1, 1, 1))
    return padded.flatten(0, 2).index_copy(0, places, around).view_as(padded)


@lru_cache(maxsize=8)
def border(side: int) -> tuple[Int64[Tensor, "B"], Int64[Tensor, "B 3"]]:
    """Places around the faces in :func:`bordered`, and the three texels whose mean each holds; edges name one thrice.

    Both count face by face and row by row.
    """
    wide = side + 2
    rings = [
        (row, column) for row, column in product(range(wide), repeat=2) if not {row, column}.isdisjoint((0, wide - 1))
    ]
    places, sources = [], []
    for face, (row, column) in product(range(FACES), rings):
        places.append((face * wide + row) * wide + column)
        sources.append(_texels_beyond(face, row - 1, column - 1, side))
    return torch.tensor(places), torch.tensor(sources)


def _texels_beyond(face: int, row: int, column: int, side: int) -> tuple[int, int, int]:
    """The texels that a place just outside ``face`` stands for; ``row`` and ``column`` are -1 or ``side`` outside."""
    axis, last = face // 2, side - 1
    across, down = OTHERS[axis]
    at = {axis: last if face % 2 == 0 else 0, across: column, down: row}
    beyond = [other for other in (across, down) if not 0 <= at[other] <= last]
    signs = {other: at[other] > 0 for other in beyond}
    inside = {other: min(max(number, 0), last) for other, number in at.items()}
    meeting = [2 * other + (not signs[other]) for other in beyond]
    if len(beyond) == 2:
        meeting.append(face)
    texels = [_texel(number, inside, side) for number in meeting]
    return (texels[0], texels[-1], texels[len(texels) // 2])


def _texel(face: int, at: dict[int, int], side: int) -> int:
    across, down = OTHERS[face // 2]
    return (face * side + at[down]) * side + at[across]


def cubemap_places(
    directions: Float[Tensor, "P 3"], side: int
) -> tuple[Int64[Tensor, "P"], Float[Tensor, "P"], Float[Tensor, "P"]]:
    """Face, column and row of each direction, of any length, in texels of a bordered face: the centre of its first own
    texel is at 1. The zero vector, a Gaussian seen from its own centre, is the middle of the first face."""
    axis = directions.detach().abs().argmax(-1)
    along = directions.gather(-1, axis[:, None])
    others = torch.tensor(OTHERS, device=directions.device)[axis]
    on_face = directions.gather(-1, others) / along.abs().clamp_min(SMALLEST_LENGTH)
    across, down = ((on_face + 1) * (0.5 * side) + 0.5).unbind(-1)
    return 2 * axis + (along[:, 0] < 0), across, down


def looked_up(faces: Float[Tensor, "6 W W C"], directions: Float[Tensor, "P 3"]) -> Float[Tensor, "P C"]:
    """Bordered ``faces`` towards the directions, differentiable in both."""
    wide = faces.shape[1]
    face, across, down = cubemap_places(directions, wide - 2)
    column, row = (place.detach().floor().clamp(0, wide - 2).long() for place in (across, down))
    right, below = (across - column)[:, None], (down - row)[:, None]
    texels, first = faces.flatten(0, 2), (face * wide + row) * wide + column
    above = texels[first] * (1 - right) + texels[first + 1] * right
    under = texels[first + wide] * (1 - right) + texels[first + wide + 1] * right
    return above * (1 - below) + under * below
