"""Several Gaussians in one place that look like one: opacity and size of the copies (3DGS-MCMC, equation 9)."""

import math
from collections.abc import Sequence
from functools import cache

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.fit.strategies.wander import turned

MOST_COPIES = 51
"""More in one place than this get the numbers of as many, as in the paper: the sum below has binomials up to it."""

SHRINK = 1.6
"""A split Gaussian's children are this much narrower (3DGS: 0.8 times the number of children)."""

LEAST = 1e-6
"""Least opacity, and least share of light that a row lets through: opacities are floats, and beyond it they are one."""


def as_copies(
    table: Gaussians, copies: Int[Tensor, "N"], faintest: float, opacity_columns: Sequence[str] = ()
) -> Gaussians:
    """The table with each row as one of ``copies`` in its place, which together show what it shows.

    Front to back, n copies of opacity p let through what one of opacity o does if (1 - p)^n = 1 - o. They would be
    wider than the one, so they shrink until their blended alpha, a function of the place on a line, has its integral:

        scale' = scale o / sum over j = 1..n of C(n, j) (-1)^(j - 1) p^j / sqrt(j)

    which is the paper's double sum, its inner binomials added up. Opacities below ``faintest`` are raised to it, so
    that a copy is not taken for dead at once. ``opacity_columns``, which add to the opacity towards a camera, get the
    share p / o: from where the one is not seen its copies are not, and elsewhere they show nearly what it shows.
    """
    counted = copies.clamp(1, MOST_COPIES)
    whole = table.opacity_logits.double().sigmoid().clamp(LEAST, 1 - LEAST)
    each = -torch.expm1(torch.log1p(-whole) / counted)
    powers = torch.arange(1, MOST_COPIES + 1, dtype=torch.float64, device=each.device)
    factors = _factors().to(each.device)[counted - 1]
    width = (factors * each[:, None] ** powers).sum(1)
    shrunk = table.log_scales + (whole / width).log()[:, None].to(table.log_scales)
    logits = each.clamp(min(faintest, 1 - LEAST), 1 - LEAST).logit().to(table.opacity_logits)
    alone = counted == 1
    share = torch.where(alone, 1.0, each / whole)
    dimmed = {name: in_share(table.appearance[name], share) for name in opacity_columns}
    return Gaussians(
        table.means,
        torch.where(alone[:, None], table.log_scales, shrunk),
        table.quats,
        torch.where(alone, table.opacity_logits, logits),
        table.appearance | dimmed,
    )


def as_parts(table: Gaussians, copies: Int[Tensor, "N"], faintest: float) -> Gaussians:
    """The table with each row of more than one of ``copies`` as narrow as 3DGS makes the children of what it splits
    (section 5.2), and as opaque as it was, or as ``faintest``.

    Ours. Copies that move apart no longer lie behind each other: with the opacity of :func:`as_copies` together they
    would show less at each place than the one did, and more around it.
    """
    several = copies > 1
    narrower = table.log_scales - math.log(SHRINK)
    faintest_logit = math.log(max(faintest, LEAST)) - math.log1p(-max(faintest, LEAST))
    return Gaussians.from_columns(
        table.columns()
        | {
            "log_scales": torch.where(several[:, None], narrower, table.log_scales),
            "opacity_logits": torch.where(
                several, table.opacity_logits.clamp_min(faintest_logit), table.opacity_logits
            ),
        }
    )


def moved_apart(table: Gaussians, width: float, draw: torch.Generator) -> Gaussians:
    """The table with each centre moved by ``width`` standard deviations times a normal number along each of its axes.

    Ours. Copies in one place have all but parallel gradients, and Adam takes their lengths away: they would stay
    together for much of a short run, and show what one of them could.
    """
    drawn = torch.randn(len(table), 3, generator=draw).to(table.means)
    offsets = turned(width * table.scales * drawn, table.quats)
    return Gaussians.from_columns(table.columns() | {"means": table.means + offsets})


def in_share(column: Float[Tensor, "N *width"], share: Float[Tensor, "N"]) -> Float[Tensor, "N *width"]:
    """Each row times its share."""
    return column * share.to(column).view(-1, *[1] * (column.dim() - 1))


@cache
def _factors() -> Float[Tensor, "n j"]:
    """Row n - 1, column j - 1: C(n, j) (-1)^(j - 1) / sqrt(j); zero for j above n."""
    counts = range(1, MOST_COPIES + 1)
    rows = [[math.comb(n, j) * (-1) ** (j - 1) / math.sqrt(j) for j in counts] for n in counts]
    return torch.tensor(rows, dtype=torch.float64)


def drawn_rows(weights: Float[Tensor, "N"], count: int, draw: torch.Generator) -> Int[Tensor, "count"]:
    """``count`` rows, drawn with replacement and with chances in proportion to ``weights``, of which one is positive.

    By one running sum in double precision, which no number of threads can change.
    """
    ends = weights.double().cpu().cumsum(0)
    places = torch.rand(count, generator=draw, dtype=torch.float64) * ends[-1]
    found = torch.searchsorted(ends, places, right=True)
    last = int((weights > 0).nonzero()[-1])  # rounding may put a place at the very end
    return found.clamp_max(last).to(weights.device)
