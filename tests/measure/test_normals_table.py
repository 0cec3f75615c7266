"""The table of normals' errors marks the best of each column and says where little was compared."""

import io

import pytest
from rich.console import Console

from ringlight.measure.normal_error import NormalScore
from ringlight.measure.normals_table import NormalsTable


def score(mean: float | None, near: float | None = 0.5, compared: float = 1.0) -> NormalScore:
    return NormalScore(mean=mean, median=mean, within_11_25=near, compared=compared, pixels=10)


def test_the_smaller_angle_and_the_larger_share_are_best() -> None:
    table = NormalsTable([("a", score(12.0, 0.7)), ("b", score(8.0, 0.6)), ("c", score(None, None, 0.0))], 3)
    best = [[cell.best for cell in row] for row in table.grid().rows()]
    assert best == [[False, False, False, True, False, False], [False, True, True, False, False, False], [False] * 6]
    assert [row[1].text for row in table.grid().rows()] == ["12.0", "8.0", "-"]
    assert table.notes() == ("c covers less than 50% of the true surface; is this the truth of its scene?",)


@pytest.mark.parametrize("width", [30, 60, 200])
def test_it_fits_any_terminal(width: int) -> None:
    screen = io.StringIO()
    Console(file=screen, width=width).print(NormalsTable([("a-run-with-a-long-name", score(12.34))], 10))
    lines = screen.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert "12.3" in lines[2]
