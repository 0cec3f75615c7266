"""Vector quantisation: a codebook for weighted rows by k-means (Lloyd 1982), with the same bits for any thread count.

Rows and codes are whole numbers of a fine grid, in double precision: products and their sums are exact then, in
whatever order a matrix product takes them. First codes are drawn by weight, without replacement (Efraimidis and
Spirakis, "Weighted random sampling with a reservoir", 2006); a code that nothing uses becomes the row that adds most to
the error (after LightGaussian, Fan et al. 2023, which replaces the codes that are used least).
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

GRID = 1 << 20
"""Steps of the grid up to the largest value. Products of D <= 45 such numbers stay below 2^53 / 16."""

BLOCK_NUMBERS = 1 << 22
"""Distances that are held at once: 32 MB."""

MOST_FITTED = 1 << 17
"""Rows that a codebook is fitted to; of more, so many are drawn by weight."""


@torch.no_grad()
def codebook(
    rows: Float[Tensor, "M D"], weights: Float[Tensor, "M"], codes: int, rounds: int, drawn: torch.Generator
) -> tuple[Float[Tensor, "K D"], Int[Tensor, "M"]]:
    """Up to ``codes`` centres, in the rows' units, and each row's; ``weights`` are 0 or more.

    With no fewer codes than rows the rows are their own centres.
    """
    if codes >= len(rows):
        return rows.clone(), torch.arange(len(rows))
    step = float(rows.abs().amax()) / GRID or 1.0
    grid = (rows.double() / step).round()
    importance = weights.double().clamp_min(torch.finfo(torch.float64).tiny)
    order = _drawn_by_weight(importance, drawn)
    fitted, heavy = grid[order[:MOST_FITTED]], importance[order[:MOST_FITTED]]
    book, numbers = grid[order[:codes]], None
    for _ in range(rounds):
        found, errors = nearest(fitted, book)
        if numbers is not None and torch.equal(found, numbers):
            break
        numbers, book = found, _centres(fitted, heavy, found, errors, book)
    return (book * step).float(), nearest(grid, book)[0]


def nearest(rows: Float[Tensor, "M D"], book: Float[Tensor, "K D"]) -> tuple[Int[Tensor, "M"], Float[Tensor, "M"]]:
    """The number of each row's nearest code, and the squared distance to it."""
    norms, block = book.square().sum(1), max(BLOCK_NUMBERS // len(book), 1)
    found = [torch.addmm(norms, part, book.T, alpha=-2).min(1) for part in rows.split(block)]
    numbers = torch.cat([minimum.indices for minimum in found])
    return numbers, torch.cat([minimum.values for minimum in found]) + rows.square().sum(1)


def _drawn_by_weight(weights: Float[Tensor, "M"], drawn: torch.Generator) -> Int[Tensor, "M"]:
    """All rows in the order in which a lottery without replacement draws them."""
    uniform = torch.rand(len(weights), generator=drawn, dtype=torch.float64).clamp_min(torch.finfo(torch.float64).tiny)
    return (uniform.log() / weights).argsort(descending=True, stable=True)


def _centres(
    rows: Float[Tensor, "M D"],
    weights: Float[Tensor, "M"],
    numbers: Int[Tensor, "M"],
    errors: Float[Tensor, "M"],
    before: Float[Tensor, "K D"],
) -> Float[Tensor, "K D"]:
    """Weighted means, on the grid; those of codes without a row are the rows of most error."""
    total = torch.bincount(numbers, weights, len(before))
    sums = torch.zeros_like(before).index_add_(0, numbers, weights[:, None] * rows)
    unused = torch.bincount(numbers, minlength=len(before)) == 0
    centres = (sums / torch.where(unused, 1, total)[:, None]).round()
    worst = (weights * errors).argsort(descending=True, stable=True)
    centres[unused] = rows[worst[: int(unused.sum())]]
    return centres
