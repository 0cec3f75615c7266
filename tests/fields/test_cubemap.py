"""The texels around a cubemap's faces."""

import pytest
import torch

from ringlight.fields.cubemap import FACES, OTHERS, border, bordered, looked_up


def centres(side: int) -> torch.Tensor:
    """The direction of every texel's centre, [6 S S 3]."""
    along = (torch.arange(side) + 0.5) / side * 2 - 1
    found = torch.empty(FACES, side, side, 3)
    for face in range(FACES):
        across, down = OTHERS[face // 2]
        found[face, ..., face // 2] = 1.0 - 2 * (face % 2)
        found[face, ..., across] = along[None, :]
        found[face, ..., down] = along[:, None]
    return found


@pytest.mark.parametrize("side", [1, 3, 8])
def test_every_centre_shows_its_own_texel(side: int):
    faces = torch.rand(FACES, side, side, 2, generator=torch.Generator().manual_seed(1))
    seen = looked_up(bordered(faces), centres(side).flatten(0, 2))
    torch.testing.assert_close(seen, faces.flatten(0, 2), atol=1e-5, rtol=0)


def test_no_direction_is_the_middle_of_the_first_face():
    """As that of a Gaussian seen from its own centre."""
    faces = torch.rand(FACES, 3, 3, 2, generator=torch.Generator().manual_seed(1))
    assert torch.equal(looked_up(bordered(faces), torch.zeros(1, 3)), faces[:1, 1, 1])


@pytest.mark.parametrize("side", [1, 3, 8])
def test_neighbours_beyond_an_edge_lie_near_in_direction(side: int):
    """A border shows directions, where texels hold their own: close to what continues the face."""
    shown = bordered(centres(side))
    inner = shown[:, 1:-1, 1:-1]
    assert torch.equal(inner, centres(side))
    places, sources = border(side)
    assert len(places.unique()) == len(places) == FACES * 4 * (side + 1)
    assert 0 <= int(sources.min()) <= int(sources.max()) < FACES * side * side
    unit = torch.nn.functional.normalize(shown, dim=-1)
    across = (unit[:, :, 1:] * unit[:, :, :-1]).sum(-1)
    down = (unit[:, 1:] * unit[:, :-1]).sum(-1)
    # Two texels that touch are at most two texels' widths apart, seen from the middle.
    nearest = torch.tensor(2 * 2.0 / side).clamp_max(2.2).cos()
    assert min(float(across.min()), float(down.min())) >= float(nearest) - 1e-6
