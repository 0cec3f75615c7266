"""Octahedral maps agree with their nodes and show no seam."""

import torch

from ringlight.core.directions import normalize, octahedral_from_directions
from ringlight.core.randomness import generator
from ringlight.fields.octahedral import OctahedralMaps, sewn
from ringlight.fields.tables import between_map_nodes, octahedral_nodes


def maps(*sides: int, features: int = 3) -> OctahedralMaps:
    return OctahedralMaps(sides, features, generator(0, 0, "maps"))


def test_levels_stand_side_by_side_and_equal_their_nodes():
    both = maps(5, 8)
    uv = octahedral_from_directions(octahedral_nodes(8))
    features = both(uv)
    assert features.shape == (64, 6)
    torch.testing.assert_close(features[:, 3:], sewn(both.levels[1]).flatten(0, 1), rtol=0, atol=1e-6)
    by_table = between_map_nodes(sewn(both.levels[0]).flatten(0, 1), uv)
    torch.testing.assert_close(features[:, :3], by_table, rtol=0, atol=1e-6)


def test_directions_on_both_sides_of_a_seam_see_the_same():
    torch.manual_seed(0)
    turn = torch.rand(200) * 2 * torch.pi
    low = -torch.rand(200)
    one_axis = torch.stack([torch.zeros(200), turn.cos() * 0.5, low], -1)
    for seam in (one_axis, one_axis[:, [1, 0, 2]]):  # the planes x = 0 and y = 0 below the equator: the square's edges
        step = torch.where(seam == 0, 1e-5, 0.0) * (seam[:, 2:] < 0)
        here, there = (octahedral_from_directions(normalize(seam + side * step)) for side in (1, -1))
        assert (here - there).abs().max() > 1, "the two are far apart on the square"
        field = maps(6, 9)
        torch.testing.assert_close(field(here), field(there), rtol=0, atol=1e-4)


def test_sewing_takes_the_mean_of_what_is_one_direction_and_leaves_the_rest():
    level = torch.arange(16.0).reshape(4, 4, 1)
    flat = sewn(level)[..., 0]
    assert torch.equal(flat[1:3, 1:3], level[1:3, 1:3, 0])
    assert flat[0].tolist() == [7.5, 1.5, 1.5, 7.5], "the four corners are one pole"
    assert flat[:, 0].tolist() == [7.5, 6.0, 6.0, 7.5]
    torch.testing.assert_close(sewn(sewn(level)), sewn(level))


def test_gradients_reach_every_level():
    field = maps(4, 7).double()
    uv = (torch.rand(30, 2, dtype=torch.float64) * 1.9 - 0.95).requires_grad_()
    levels = list(field.levels)
    assert torch.autograd.gradcheck(lambda uv, *_: field(uv), (uv, *levels))


def test_the_same_generator_draws_the_same_maps():
    first, second = maps(8), maps(8)
    assert torch.equal(first.levels[0], second.levels[0])
    assert 0.005 < first.levels[0].std() < 0.02
