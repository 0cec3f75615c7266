"""One bad number is found wherever it lies, and named."""

import pytest
import torch

from ringlight.core.finite import first_not_finite

BAD = (float("nan"), float("inf"), -float("inf"))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.float16, torch.bfloat16])
@pytest.mark.parametrize("length", [1, 7, 16, 37, 100])
def test_wherever_it_lies(length: int, dtype: torch.dtype, bad: float) -> None:
    for place in range(length):
        values = torch.linspace(-3, 3, length).to(dtype)
        assert first_not_finite({"good": values}) is None
        values[place] = bad
        found = first_not_finite({"good": torch.ones(3), "bad": values})
        assert found is not None
        assert str(found) == f"bad holds {bad} in row {place}"


def test_a_table_that_several_threads_look_through() -> None:
    table = torch.zeros(100_000, 3)
    table[77_777, 1] = float("nan")
    table[99_999, 2] = float("inf")
    assert str(first_not_finite({"table": table})) == "table holds nan in rows 77777, 99999"
    assert str(first_not_finite({"turned": table.T})) == "turned holds nan in rows 1, 2"


def test_nothing_whole_numbers_and_the_largest_are_finite() -> None:
    largest = torch.tensor([torch.finfo(torch.float32).max, -torch.finfo(torch.float32).max])
    assert first_not_finite({"none": torch.zeros(0, 3), "whole": torch.arange(3), "largest": largest}) is None
    assert str(first_not_finite({"one": torch.tensor(float("nan"))})) == "one holds nan in row 0"
