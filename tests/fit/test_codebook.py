"""k-means: the nearest code is the nearest, centres are better than what was drawn, and bits depend on no thread."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.randomness import generator
from ringlight.fit.codebook import GRID, codebook, nearest


def cloud(count: int, width: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows around twelve middles, and weights that differ a thousandfold."""
    drawn = torch.Generator().manual_seed(seed)
    middles = torch.randn(12, width, generator=drawn)
    rows = middles[torch.randint(12, (count,), generator=drawn)] + 0.05 * torch.randn(count, width, generator=drawn)
    return rows, 10 ** (3 * torch.rand(count, generator=drawn))


def error(rows: torch.Tensor, weights: torch.Tensor, book: torch.Tensor, numbers: torch.Tensor) -> float:
    return float((weights[:, None] * (rows - book[numbers]).square()).sum())


@settings(max_examples=30)
@given(st.integers(1, 50), st.integers(1, 45), st.integers(1, 20), st.integers(0, 1000))
def test_the_nearest_code_is_that_of_all_distances(count: int, width: int, codes: int, seed: int):
    drawn = torch.Generator().manual_seed(seed)
    rows = torch.randint(-GRID, GRID + 1, (count, width), generator=drawn).double()
    book = torch.randint(-GRID, GRID + 1, (codes, width), generator=drawn).double()
    distances = (rows[:, None] - book[None]).square().sum(-1)  # whole numbers below 2^53: exact
    numbers, errors = nearest(rows, book)
    assert torch.equal(errors, distances.amin(1))
    assert torch.equal(distances.gather(1, numbers[:, None])[:, 0], errors)


def test_centres_are_weighted_means_and_the_error_falls():
    rows, weights = cloud(3000, 24)
    drawn, _ = codebook(rows, weights, 40, 0, generator(0, 1, "codebook"))
    before = error(rows, weights, drawn, torch.cdist(rows, drawn).argmin(1))
    book, numbers = codebook(rows, weights, 40, 30, generator(0, 1, "codebook"))
    assert error(rows, weights, book, numbers) < 0.9 * before
    for code in range(len(book)):
        mine = numbers == code
        assert mine.any()
        mean = (weights[mine, None] * rows[mine]).sum(0) / weights[mine].sum()
        torch.testing.assert_close(book[code], mean, rtol=1e-4, atol=2e-3)


def test_heavy_rows_lie_nearer_to_their_codes():
    rows = torch.randn(2000, 6, generator=torch.Generator().manual_seed(2))
    weights = torch.ones(2000)
    weights[:200] = 1000.0
    book, numbers = codebook(rows, weights, 60, 20, generator(0, 1, "codebook"))
    distance = (rows - book[numbers]).norm(dim=1)
    assert distance[:200].mean() < 0.7 * distance[200:].mean()


def test_rows_that_are_no_more_than_codes_are_kept():
    rows, weights = cloud(30, 5)
    book, numbers = codebook(rows, weights, 30, 5, generator(0, 1, "codebook"))
    assert torch.equal(book[numbers], rows)


@pytest.mark.parametrize("value", [0.0, 0.7])
def test_rows_that_are_all_alike_have_their_code(value: float):
    book, numbers = codebook(torch.full((50, 4), value), torch.zeros(50), 6, 5, generator(0, 1, "codebook"))
    torch.testing.assert_close(book[numbers], torch.full((50, 4), value))


def test_bits_do_not_depend_on_threads():
    rows, weights = cloud(5000, 24, seed=3)
    found, threads = [], torch.get_num_threads()
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            found.append(codebook(rows, weights, 300, 8, generator(7, 1, "codebook")))
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(a, b) for one in found[1:] for a, b in zip(found[0], one, strict=True))
