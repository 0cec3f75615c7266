"""What a step leaves out is a pure function of seed, step and number of rows; the mean of each opacity is kept."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.data.batches import ImageBatches
from ringlight.data.dropout import Dropout, LeftOut
from tiny_scene import tiny_scene

CPU = torch.device("cpu")

ROWS = 20_000


@given(st.floats(0.01, 0.9), st.integers(0, 2**31), st.integers(1, 30_000))
def test_a_share_is_left_out_and_the_others_make_up_for_it(share: float, seed: int, step: int):
    factors = LeftOut(share, seed, step).factors(ROWS, CPU)
    assert factors.unique().tolist() == pytest.approx([0, 1 / (1 - share)])
    deviation = (share * (1 - share) / ROWS) ** 0.5
    assert abs((factors == 0).double().mean().item() - share) < 6 * deviation
    assert abs(factors.double().mean().item() - 1) < 6 * deviation / (1 - share)


def test_the_same_step_leaves_out_the_same_and_others_do_not():
    first = LeftOut(0.5, 7, 11).factors(ROWS, CPU)
    assert torch.equal(first, LeftOut(0.5, 7, 11).factors(ROWS, CPU))
    assert not torch.equal(first, LeftOut(0.5, 7, 12).factors(ROWS, CPU))
    assert not torch.equal(first, LeftOut(0.5, 8, 11).factors(ROWS, CPU))


def test_nothing_is_left_out_before_it_begins_nor_of_a_run_without_it():
    batches = ImageBatches(tiny_scene(), seed=3, dropout=Dropout(0.1, after=5))
    assert [batches.at(step).left_out is None for step in (1, 5, 6, 50)] == [True, True, False, False]
    assert batches.at(6).left_out == LeftOut(0.1, 3, 6)
    assert ImageBatches(tiny_scene(), seed=3).at(6).left_out is None
