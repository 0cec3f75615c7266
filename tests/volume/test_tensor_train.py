"""Tensor trains: entries are products of matrices, interpolation is that of the grid, rounding tells its error."""

import itertools

import pytest
import torch
import torch.nn.functional
from hypothesis import given, settings
from hypothesis import strategies as some

from ringlight.volume.prolongation import along_axis, prolonged
from ringlight.volume.tensor_train import contracted, gathered, grid_of, octant_path
from ringlight.volume.tt_ranks import numbers_of, ranks_of
from ringlight.volume.tt_rounding import rounded
from volume.trains import drawn_cores, smooth_grid

SAME = {"rtol": 1e-9, "atol": 1e-9}


OF_FIRST = some.sampled_from([8, 4, 2])
"""Octants of the first core."""


def all_nodes(*sides: int) -> torch.Tensor:
    return torch.tensor(list(itertools.product(*map(range, sides))))


def sides_of(levels: int, first: int) -> tuple[int, int, int]:
    long, short = 2**levels, 2 ** (levels - 1)
    return {8: (long, long, long), 4: (short, long, long), 2: (short, short, long)}[first]


def interpolated(grid: torch.Tensor, axis: int) -> torch.Tensor:
    """Along one axis of [S S S C], node by node."""
    after = torch.cat([grid.narrow(axis, 1, grid.shape[axis] - 1), grid.narrow(axis, grid.shape[axis] - 1, 1)], axis)
    return torch.stack([grid, (grid + after) / 2], axis + 1).flatten(axis, axis + 1)


@given(some.integers(1, 3), some.integers(1, 3), some.integers(1, 30), OF_FIRST)
@settings(deadline=None)
def test_entries_are_products_of_a_matrix_of_each_core(payload: int, levels: int, most: int, first: int):
    cores = drawn_cores(payload, levels, most, first=first)
    nodes = all_nodes(*sides_of(levels, first))
    expected = []
    for node in nodes.tolist():
        product = torch.eye(payload, dtype=torch.float64)
        for level, core in enumerate(cores):
            x, y, z = ((place >> (levels - 1 - level)) & 1 for place in node)
            product = product @ core[:, 4 * x + 2 * y + z]
        expected.append(product[:, 0])
    expected = torch.stack(expected)
    torch.testing.assert_close(grid_of(cores).view(-1, payload), expected, **SAME)
    paths = octant_path(nodes, levels)
    torch.testing.assert_close(gathered(cores, paths), expected, **SAME)
    torch.testing.assert_close(contracted(cores).T[paths], expected, **SAME)
    assert contracted(cores).shape[1] == len(nodes) == paths.max() + 1


def test_ranks_are_trapezoids_and_numbers_those_of_the_paper():
    assert ranks_of(1, 8, 200) == (1, 8, 64, 200, 200, 200, 64, 8, 1)
    assert ranks_of(27, 8, 280) == (27, 216, 280, 280, 280, 280, 64, 8, 1)
    assert 3.3e6 < numbers_of(1, 8, 200) + numbers_of(27, 8, 280) < 3.5e6
    assert ranks_of(27, 9, 280, 2) == (27, 54, 280, 280, 280, 280, 280, 64, 8, 1)
    for first in (8, 4, 2):
        assert numbers_of(3, 4, 30, first) == sum(core.numel() for core in drawn_cores(3, 4, 30, first=first))


@given(some.integers(1, 3), some.integers(1, 3), some.integers(1, 20), some.integers(0, 99), OF_FIRST)
@settings(deadline=None, max_examples=40)
def test_prolongation_is_linear_interpolation_of_the_grid(payload: int, levels: int, most: int, seed: int, first: int):
    cores = drawn_cores(payload, levels, most, seed, first=first)
    grid = grid_of(cores)
    for axis in range(3):
        cores, grid = along_axis(cores, axis), interpolated(grid, axis)
    torch.testing.assert_close(grid_of(cores), grid, **SAME)
    whole, lost = prolonged(drawn_cores(payload, levels, most, seed, first=first), most=10**6)
    torch.testing.assert_close(grid_of(whole), grid, **SAME)
    assert lost < 1e-6


@given(some.integers(1, 3), some.integers(2, 3), some.integers(2, 40), some.integers(1, 30), some.integers(0, 99))
@settings(deadline=None, max_examples=25)
def test_rounding_tells_exactly_what_it_lost(payload: int, levels: int, most: int, fewer: int, seed: int):
    cores = drawn_cores(payload, levels, most, seed)
    small, lost = rounded(cores, fewer)
    assert all(max(core.shape[0], core.shape[2]) <= max(fewer, payload) for core in small)
    distance = (grid_of(small) - grid_of(cores)).norm().item()
    assert distance == pytest.approx(lost, rel=1e-6, abs=1e-7)
    assert small[0].shape[0] == payload


@given(some.integers(1, 3), some.integers(1, 12), some.integers(0, 99))
@settings(deadline=None, max_examples=15)
def test_rounding_is_near_the_best_that_can_be(payload: int, fewer: int, seed: int):
    """By sqrt(cuts) at most (Oseledets 2011, corollary 2.4); no train can be nearer than the worst cut allows."""
    cores = drawn_cores(payload, 3, 100, seed)
    _, lost = rounded(cores, fewer)
    grid = contracted(cores).view(payload, 8, 8, 8)
    cuts = [torch.linalg.svdvals(grid.flatten(k, -1).flatten(0, k - 1)) for k in (2, 3)]
    least = max(values[fewer:].norm().item() for values in cuts)
    assert least - 1e-9 <= lost <= 2**0.5 * least + 1e-9


@pytest.mark.parametrize("most", [2, 4, 12, 24])
def test_what_prolongation_loses_is_no_more_than_it_says(most: int):
    cores, _ = rounded(full_train(smooth_grid(8, 3)), most)
    exact = grid_of(cores)
    for axis in range(3):
        exact = interpolated(exact, axis)
    small, lost = prolonged(cores, most)
    shapes = [tuple(core.shape) for core in small]
    ranks = ranks_of(3, 4, most)
    assert shapes == [(left, 8, right) for left, right in itertools.pairwise(ranks)]
    assert 0 < (grid_of(small) - exact).norm() <= lost


def full_train(grid: torch.Tensor) -> list[torch.Tensor]:
    """The cores of a grid of eight nodes a side: the last ones pick its entries."""
    entries = grid.new_empty(512, grid.shape[-1])
    nodes = all_nodes(8, 8, 8)
    entries[octant_path(nodes, 3)] = grid.flatten(0, 2)
    eye = torch.eye(8, dtype=grid.dtype)
    first = entries.T.reshape(-1, 8, 64).contiguous()
    return [first, torch.einsum("oi,pj->opij", eye, eye).reshape(64, 8, 8), eye[:, :, None].contiguous()]


@given(some.lists(some.integers(-30, 30), min_size=4, max_size=4), some.booleans())
@settings(deadline=None, max_examples=20)
def test_rounding_bears_cores_whose_products_no_float_holds(exponents: list[int], beyond: bool):
    cores = drawn_cores(2, 4, 40, dtype=torch.float32)
    near, near_lost = rounded(cores, 5)
    powers = [e + 90 * beyond for e in exponents]
    far, far_lost = rounded([core * 2.0**e for core, e in zip(cores, powers, strict=True)], 5)
    mean = 2.0 ** (sum(powers) / len(powers))
    for core, other in zip(far, near, strict=True):
        assert torch.isfinite(core).all()
        torch.testing.assert_close(core / mean, other)
    assert far_lost == pytest.approx(near_lost * mean ** len(powers))


def test_rounding_leaves_an_empty_train_empty():
    cores, lost = rounded([0 * core for core in drawn_cores(2, 4, 40)], 5)
    assert lost == 0
    assert contracted(cores).abs().max() == 0


def test_rounding_has_the_same_bits_each_time():
    one, other = (rounded(drawn_cores(3, 4, 40, dtype=torch.float32), 20) for _ in range(2))
    assert one[1] == other[1]
    assert all(torch.equal(a, b) for a, b in zip(one[0], other[0], strict=True))
