"""Which rows share harmonics: those that lose least by it, whatever their significance."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.randomness import generator
from ringlight.fit.strategies.quantize_colors import rows_that_lose_least


@settings(max_examples=20, deadline=None)
@given(alike=st.integers(30, 60), odd=st.integers(6, 12), seed=st.integers(0, 1000))
def test_rows_that_are_alike_go_before_rows_of_less_significance(alike: int, odd: int, seed: int) -> None:
    """Rows of one colour lose next to nothing by a code; rows of all colours do, however little is seen of them."""
    drawn = torch.Generator().manual_seed(seed)
    colors = [3 * torch.randn(odd, 24, generator=drawn), torch.randn(24, generator=drawn).expand(alike, 24)]
    worth = torch.cat([torch.full((odd,), 0.1), torch.ones(alike)])
    rows = rows_that_lose_least(torch.cat(colors), worth, alike, 4, generator(seed, 1, "codebook"))
    alone = [row for row in range(odd) if row in rows]
    assert rows.tolist() == sorted(set(rows.tolist()))
    assert len(rows) == alike
    assert len(alone) <= 3, "rows that have a code of their own lose nothing either"


def test_of_rows_as_far_from_their_code_those_of_least_significance_share():
    seen = torch.cat([torch.eye(8), -torch.eye(8)])
    worth = torch.arange(16.0) + 1
    assert rows_that_lose_least(seen, worth, 5, 1, generator(0, 1, "codebook")).tolist() == [0, 1, 2, 3, 4]
