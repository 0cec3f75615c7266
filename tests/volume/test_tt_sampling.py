"""Whichever way a tensor train is sampled, values and gradients are those of single entries, linear in between."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some

from ringlight import _kernels
from ringlight.volume import halves, products, tensor_train_field
from ringlight.volume.products import product
from ringlight.volume.tensor_train import gathered, grid_of
from ringlight.volume.tensor_train_field import TensorTrain, TensorTrainField
from ringlight.volume.tt_corners import corners_of
from ringlight.volume.tt_sampling import from_blocks, from_grid, from_points
from volume.trains import drawn_cores

SAME = {"rtol": 1e-9, "atol": 1e-9}


def points(count: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """Most within the box, some beyond it, some on its border and on nodes."""
    drawn = torch.Generator().manual_seed(seed)
    places = torch.rand(count, 3, generator=drawn, dtype=dtype) * 1.1 - 0.05
    places[::7] = (places[::7] * 8).round() / 8
    return places


def by_single_entries(cores, places) -> torch.Tensor:
    corners = corners_of(places, len(cores))
    entries = gathered(cores, corners.paths.flatten()).unflatten(0, (-1, 8))
    return (entries * corners.shares[..., None]).sum(1)


def with_gradients(way, cores, count: int):
    leaves = [core.clone().requires_grad_() for core in cores]
    places = points(count).requires_grad_()
    values = way(leaves, places)
    weights = torch.randn(values.shape, generator=torch.Generator().manual_seed(1), dtype=values.dtype)
    found = torch.autograd.grad((values * weights).sum(), [*leaves, places])
    return [values.detach(), *found]


@given(some.integers(1, 3), some.integers(2, 4), some.integers(2, 20), some.integers(1, 60), some.data())
@settings(deadline=None, max_examples=25)
def test_all_ways_agree_in_values_and_gradients(payload: int, levels: int, most: int, count: int, data):
    first = data.draw(some.integers(1, levels - 1))
    cores = drawn_cores(payload, levels, most)
    expected = with_gradients(by_single_entries, cores, count)
    for way in (from_grid, lambda *of: from_blocks(*of, first), lambda *of: from_points(*of, first)):
        for one, other in zip(with_gradients(way, cores, count), expected, strict=True):
            torch.testing.assert_close(one, other, **SAME)


def test_no_points_have_no_values():
    cores = drawn_cores(2, 3, 10)
    for way in (from_grid, lambda *of: from_blocks(*of, 1), lambda *of: from_points(*of, 1)):
        for dtype in (torch.float32, torch.float64):
            assert way([core.to(dtype) for core in cores], torch.zeros(0, 3, dtype=dtype)).shape == (0, 2)


def test_values_are_those_of_the_grid_linear_between_its_nodes():
    cores = drawn_cores(2, 3, 10)
    grid = grid_of(cores)
    places = points(300)
    at = places.clamp(0, 1) * 8
    low = at.floor().clamp_max(7)
    share = (at - low).unbind(-1)
    (x, y, z), (x1, y1, z1) = low.long().unbind(-1), (low + 1).clamp_max(7).long().unbind(-1)
    expected = 0
    for i, j, k in ((i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)):
        weight = (share[0] if i else 1 - share[0]) * (share[1] if j else 1 - share[1])
        weight = weight * (share[2] if k else 1 - share[2])
        expected = expected + weight[:, None] * grid[x1 if i else x, y1 if j else y, z1 if k else z]
    torch.testing.assert_close(from_grid(cores, places), expected, **SAME)


@given(some.integers(1, 3), some.integers(3, 4), some.integers(1, 60), some.sampled_from([4, 2]), some.data())
@settings(deadline=None, max_examples=25)
def test_all_ways_agree_where_some_axes_have_half_the_nodes(payload: int, levels: int, count: int, first: int, data):
    """In the half of the cube, or the quarter, in which all points lie then."""
    blocks = data.draw(some.integers(1, levels - 1))
    cores = drawn_cores(payload, levels, 20, first=first)
    side = 2**levels
    last = torch.tensor([{4: side, 2: side}[first], {4: 2 * side, 2: side}[first], 2 * side]) / 2 - 1

    def inside(way):
        return lambda of, places: way(of, torch.minimum(places.clamp_min(0), last.to(places) / side))

    expected = with_gradients(inside(by_single_entries), cores, count)
    for way in (from_grid, lambda *of: from_blocks(*of, blocks), lambda *of: from_points(*of, blocks)):
        for one, other in zip(with_gradients(inside(way), cores, count), expected, strict=True):
            torch.testing.assert_close(one, other, **SAME)
        leaves = [core.float().requires_grad_() for core in cores]  # by the kernels
        ours = inside(way)(leaves, points(count).float())
        weights = torch.randn(ours.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
        by_kernels = [ours.detach(), *torch.autograd.grad((ours * weights.float()).sum(), leaves)]
        for one, other in zip(by_kernels, expected[:-1], strict=True):
            torch.testing.assert_close(one.double(), other, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("long", [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2)])
def test_a_field_is_linear_between_nodes_of_as_many_along_each_axis_as_it_says(long: tuple[int, ...]):
    field = TensorTrainField(4 if long else 3, 5, (30, 40), 5, torch.Generator().manual_seed(0), long).double()
    assert field.sides == tuple(16 if axis in long else 8 for axis in range(3))
    nodes = [torch.arange(side, dtype=torch.float64) / side for side in field.sides]
    grid = field.appearance(torch.stack(torch.meshgrid(*nodes, indexing="ij"), -1).view(-1, 3)).view(*field.sides, 5)
    assert len(grid.flatten(0, 2).unique(dim=0)) == len(nodes[0]) * len(nodes[1]) * len(nodes[2])
    padded = torch.nn.functional.pad(grid.permute(3, 0, 1, 2)[None], [0, 1] * 3, mode="replicate")
    places = points(300).clamp(0, 1)
    expected = torch.nn.functional.grid_sample(padded, (2 * places - 1).flip(1)[None, None, None], align_corners=True)
    torch.testing.assert_close(field.appearance(points(300)), expected[0, :, 0, 0].T, **SAME)


@pytest.mark.parametrize("payload", [1, 3])
def test_a_doubled_train_shows_the_same(payload: int):
    drawn = torch.Generator().manual_seed(0)
    train = TensorTrain(payload, 3, 5, 200, drawn).to(torch.float64)
    places = points(500)
    before = from_grid(train.reached, places)
    train.deepen()
    assert train.levels == 4
    torch.testing.assert_close(from_grid(train.reached, places), before, **SAME)


def test_levels_that_are_not_reached_change_no_entry():
    train = TensorTrain(2, 2, 4, 20, torch.Generator().manual_seed(0))
    coarse, all_levels = grid_of(train.reached), grid_of(list(train.cores))
    repeated = coarse.repeat_interleave(4, 0).repeat_interleave(4, 1).repeat_interleave(4, 2)
    torch.testing.assert_close(all_levels, repeated)


def test_entries_begin_with_the_same_spread_at_any_resolution():
    for levels in (2, 3, 5):
        field = TensorTrainField(levels, 6, (200, 280), 27, torch.Generator().manual_seed(0))
        for train in (field.density_train, field.appearance_train):
            assert 0.05 < grid_of(train.reached).std() < 0.2


def test_a_field_samples_by_ways_that_agree(monkeypatch: pytest.MonkeyPatch):
    """Blocks up to 64 cubed, points beyond."""
    monkeypatch.setattr(halves, "HALVES", False)
    field = TensorTrainField(7, 7, (12, 14), 5, torch.Generator().manual_seed(0))
    places = points(200, dtype=torch.float32)
    for train, values in ((field.density_train, field.density), (field.appearance_train, field.appearance)):
        expected = from_blocks(train.reached, places, 4)
        torch.testing.assert_close(values(places).view_as(expected), expected, rtol=1e-4, atol=1e-6)
        assert len(values(places[:0])) == 0


@pytest.mark.parametrize("levels", [3, 6, 7])
def test_halves_show_and_learn_nearly_the_same(levels: int, monkeypatch: pytest.MonkeyPatch):
    """By the grid, by blocks and by points. A number of seven bits is off by 0.2 %; so are eight cores and what they
    make of each other."""
    field = TensorTrainField(levels, levels, (40, 56), 5, torch.Generator().manual_seed(0))
    places = points(400, dtype=torch.float32)
    for values, train in ((field.density, field.density_train), (field.appearance, field.appearance_train)):
        found = []
        for halved in (False, True):
            monkeypatch.setattr(tensor_train_field, "multiplies_halves", lambda halved=halved: halved)
            shown = values(places)
            drawn = torch.randn(shown.shape, generator=torch.Generator().manual_seed(1))
            found.append([shown, *torch.autograd.grad((shown * drawn).sum(), train.reached)])
        for exact, rounded in zip(*found, strict=True):
            assert rounded.dtype == torch.float32
            assert 0 < (rounded - exact).norm() < 0.015 * exact.norm()


@given(some.integers(0, 600), some.integers(1, 5), some.sampled_from([torch.float32, torch.bfloat16]))
@settings(deadline=None, max_examples=25)
def test_a_product_has_as_many_rows_whatever_it_is_taken_of(count: int, width: int, dtype: torch.dtype):
    rows, matrix = torch.randn(count, width).to(dtype), torch.randn(width, 3).to(dtype)
    torch.testing.assert_close(product(rows, matrix), rows @ matrix)
    assert halves.even_rows(count, dtype) % (1 if dtype == torch.float32 else halves.ROWS) == 0


@given(some.integers(0, 1 << 20))
def test_matrices_of_halves_have_few_counts_of_rows_and_few_zeros(count: int):
    """torch compiles a program for each count, and keeps it."""
    rows = halves.even_rows(count, torch.bfloat16)
    assert count <= rows <= max(count + halves.ROWS - 1, 1.125 * count)
    assert halves.even_rows(rows, torch.bfloat16) == rows


def test_an_octave_of_counts_has_eight_sizes():
    counts = range((1 << 14) + 1, (1 << 15) + 1)
    assert len({halves.even_rows(count, torch.bfloat16) for count in counts}) == halves.SIZES


@pytest.mark.usefixtures("all_cores_afterwards")
@pytest.mark.parametrize("levels", [3, 6, 7])
def test_bits_are_the_same_for_any_number_of_threads(levels: int, monkeypatch: pytest.MonkeyPatch):
    """By the grid, by blocks and by points, in pieces so small that there are many."""
    monkeypatch.setattr(products, "PIECE", 32)
    field = TensorTrainField(levels, levels, (40, 56), 5, torch.Generator().manual_seed(0))
    places, states = points(3000, dtype=torch.float32), []
    for threads in (1, 2, 4):
        _kernels.set_threads(threads)
        state = []
        for values, train in ((field.density, field.density_train), (field.appearance, field.appearance_train)):
            shown = values(places)
            state += [shown, *torch.autograd.grad(shown.square().sum(), train.reached)]
        states.append(state)
    for others in states[1:]:
        assert all(torch.equal(one, other) for one, other in zip(states[0], others, strict=True))
