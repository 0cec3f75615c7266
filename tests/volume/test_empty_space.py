"""What is empty is found, and never what is not; a box that shrinks shows the same."""

from fractions import Fraction
from itertools import pairwise

import torch
from hypothesis import given
from hypothesis import strategies as some

from ringlight.core.want import Want
from ringlight.data.rays import RayBatch
from ringlight.volume.emptying import find_empty, shrink
from ringlight.volume.grids import growing, sides_of
from ringlight.volume.occupancy import Carving, centers, everything, is_occupied, packed, unpacked, widened
from volume.volumes import BACKGROUND, BOX, rays, volume


@given(some.integers(1, 4), some.integers(1, 5), some.integers(1, 3), some.integers(0, 1000))
def test_bits_say_which_cells_are_occupied(x: int, y: int, z: int, seed: int):
    cells = (x, y, 8 * z)
    occupied = torch.rand(cells, generator=torch.Generator().manual_seed(seed)) > 0.5
    bits = packed(occupied)
    assert torch.equal(unpacked(bits), occupied)
    assert torch.equal(is_occupied(bits, centers(cells)).view(cells), occupied)


def test_nothing_is_known_to_be_empty_at_first():
    assert is_occupied(everything(), torch.rand(50, 3) * 3 - 1).all()


def test_neighbours_of_occupied_cells_are_kept():
    occupied = torch.zeros(5, 5, 8, dtype=torch.bool)
    occupied[2, 2, 3] = True
    assert widened(occupied).sum() == 27


def ball() -> "volume":
    """Dense around the middle of the box, and empty elsewhere."""
    model = volume()
    with torch.no_grad():
        for plane in model.field.density_factors.planes:
            b, a = (torch.linspace(-1, 1, side) for side in plane.shape[:2])
            plane.copy_((4 - 30 * (a[None, :, None] ** 2 + b[:, None, None] ** 2)).clamp_min(-4).expand_as(plane))
        for line in model.field.density_factors.lines:
            line.fill_(0.5)
    model.occupied = everything()
    return model


def test_shrunk_to_what_is_not_empty_it_shows_the_same():
    model, through = ball(), rays(400)
    batch = RayBatch(through, torch.zeros(400, 3), BACKGROUND)
    before = model.predict(batch, Want.EXACT)
    box = find_empty(model)
    assert 0 < unpacked(model.occupied).float().mean() < 0.7
    assert shrink(model, box)
    assert (model.box[0] > BOX[0]).any()
    assert ((model.box[0] >= BOX[0]) & (model.box[1] <= BOX[1])).all()
    after = model.predict(batch, Want.EXACT)
    assert before.alpha.max() > 0.99
    # Steps begin elsewhere on each ray, and are of another length.
    assert (before.color - after.color).abs().mean() < 0.01


def test_what_was_empty_stays_empty_but_for_a_layer():
    model = ball()
    left = torch.zeros(10, 10, 16, dtype=torch.bool)
    left[:5] = True
    model.skip_all_but(left)
    low, high = model.box.clone()
    box = find_empty(model)
    middle, one_cell = (low + high)[0] / 2, (high - low)[0] / model.occupied.shape[0]
    assert low[0] < box[0, 0] < middle
    assert box[1, 0] <= middle + 1.01 * one_cell


def overlaps(low: Fraction, high: Fraction, cells: int, of: int) -> torch.Tensor:
    """[cells of]: whether cells from ``low`` to ``high`` meet those from -1 to 1, in exact numbers."""
    mine = [low + (high - low) * Fraction(k, cells) for k in range(cells + 1)]
    theirs = [-1 + Fraction(2 * k, of) for k in range(of + 1)]
    return torch.tensor([[a < d and c < b for c, d in pairwise(theirs)] for a, b in pairwise(mine)])


@given(some.tuples(*[some.integers(-12, 9)] * 3), some.tuples(*[some.integers(1, 20)] * 3), some.integers(0, 1000))
def test_cells_that_meet_something_of_a_carving_are_told(eighths: tuple[int], lengths: tuple[int], seed: int):
    low, high = eighths, tuple(start + length for start, length in zip(eighths, lengths, strict=True))
    left = torch.rand(3, 5, 8, generator=torch.Generator().manual_seed(seed)) > 0.8
    found = Carving(torch.tensor([[-1.0, -1, -1], [1, 1, 1]]), left).met_by(torch.tensor([low, high]) / 8, (4, 3, 8))
    sides = zip(low, high, (4, 3, 8), left.shape, strict=True)
    x, y, z = (overlaps(Fraction(a, 8), Fraction(b, 8), cells, of).float() for a, b, cells, of in sides)
    assert torch.equal(found, torch.einsum("ai,bj,ck,ijk->abc", x, y, z, left.float()) > 0)


def test_a_carving_meets_its_own_cells_alone():
    left = torch.rand(6, 5, 16, generator=torch.Generator().manual_seed(0)) > 0.7
    carving = Carving(BOX, left)
    assert torch.equal(carving.met_by(BOX, (6, 5, 16)), left)
    coarse = torch.nn.functional.max_pool3d(left[None, None].float(), (2, 5, 2))[0, 0] > 0
    assert torch.equal(carving.met_by(BOX, (3, 1, 8)), coarse)


def test_nothing_beyond_a_carving_is_found_again():
    model = ball()
    left = torch.zeros(10, 10, 16, dtype=torch.bool)
    left[:5] = True
    model.skip_all_but(left)
    middle = model.box[:, 0].mean()
    assert find_empty(model, Carving(model.box, left))[1, 0] <= middle
    assert find_empty(model, Carving(model.box, torch.zeros_like(left))).equal(model.box)


def test_a_volume_of_which_all_is_empty_keeps_its_box():
    model = volume()
    with torch.no_grad():
        for line in model.field.density_factors.lines:
            line.zero_()
    assert torch.equal(find_empty(model), model.box)
    assert not shrink(model, model.box)


def test_a_grid_has_as_many_voxels_as_asked_for():
    x, y, z = sides_of(BOX, 100**3)
    assert 0.9 < x * y * z / 100**3 <= 1
    steps = growing(128, 300, 5)
    ratios = [b / a for a, b in zip((128**3, *steps), steps, strict=False)]
    assert abs(steps[-1] / 300**3 - 1) < 1e-9
    assert max(ratios) - min(ratios) < 1e-9
