"""The picture of a view's normals: three panels, a scale, and no colour that could be mistaken."""

import numpy as np
import pytest

from ringlight.measure.colormap import ember
from ringlight.measure.normal_error import compare_normals, score_of
from ringlight.measure.normal_picture import LACKING, NOTHING, TOP, normal_picture
from ringlight.measure.sheet_layout import GAP, MARGIN, MAX_WIDTH, panel
from true_normals_file import turned

SIZE = 8
UP = np.array([0.0, 0.0, 1.0])


def test_each_pixel_has_its_colour() -> None:
    truth = np.tile(UP, (SIZE, SIZE, 1))
    normals, alpha = turned(truth, 15.0), np.ones((SIZE, SIZE, 1))
    truth[0], alpha[1] = 0, 0
    view = compare_normals(normals, alpha, truth)
    shown = panel(SIZE, SIZE, 3)
    pixels = np.asarray(normal_picture(view, "test/r_0.png", score_of(view)))
    bottom = pixels.shape[0] - MARGIN
    where = [MARGIN + index * (shown.width + GAP) + shown.width // 2 for index in range(3)]
    top = next(y for y in range(MARGIN, bottom) if tuple(pixels[y, where[2]]) == NOTHING)
    rows = [top + (2 * row + 1) * shown.height // (2 * SIZE) for row in range(3)]
    assert [tuple(pixels[y, where[2]]) for y in rows[:2]] == [NOTHING, LACKING]
    assert tuple(pixels[rows[2], where[2]]) == tuple(ember(np.array([[15 / TOP]]))[0, 0])
    assert tuple(pixels[rows[2], where[1]]) == (128, 128, 255)
    assert tuple(pixels[rows[0], where[1]]) == (255, 255, 255)
    assert tuple(pixels[rows[1], where[0]]) == (255, 255, 255)


@pytest.mark.parametrize("size", [(1, 1), (2, 300), (1200, 3)])
def test_any_size_and_no_surface_at_all(size: tuple[int, int]) -> None:
    view = compare_normals(np.full((*size, 3), np.nan), np.ones((*size, 1)), np.zeros((*size, 3)))
    sheet = normal_picture(view, "ä" * 500, score_of(view))
    assert 3 * 260 < sheet.width <= MAX_WIDTH
    assert 10 < sheet.height < 2000
