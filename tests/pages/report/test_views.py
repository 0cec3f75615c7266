"""Which views are shown, and that pictures on the page are those of the run."""

import base64
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from ringlight.measure.colormap import ember
from ringlight.pages.report.encoded import MOST_SIDE, error_url, picture_url
from ringlight.pages.report.groups import Group
from ringlight.pages.report.sections import view_cards
from ringlight.pages.report.views import ViewsShown, chosen


@given(count=st.integers(1, 40), of=st.integers(0, 400))
def test_views_are_the_worst_the_best_and_some_between(count: int, of: int) -> None:
    ranks = chosen(count, of)
    assert ranks == sorted(set(ranks))
    assert len(ranks) == min(count, of)
    assert all(0 <= rank < of for rank in ranks)
    worst, best = max(count // 3, 1), count // 3
    assert set(range(min(worst, of))) <= set(ranks)
    assert set(range(max(of - best, 0), of)) <= set(ranks)


def decoded(url: str) -> np.ndarray:
    kind, _, text = url.partition(",")
    assert kind == "data:image/webp;base64"
    return np.array(Image.open(BytesIO(base64.b64decode(text))).convert("RGB")).astype(float)


@pytest.mark.parametrize("shape", [(30, 40), (1000, 1600), (2000, 900)])
def test_pictures_are_shrunk_and_else_as_they_are(shape: tuple[int, int]) -> None:
    rows, columns = np.mgrid[: shape[0], : shape[1]] / np.array(shape)[:, None, None]
    picture = (np.stack([rows, columns, 1 - rows], -1) * 255).round().astype(np.uint8)
    shown = decoded(picture_url(picture))
    assert max(shown.shape) == min(MOST_SIDE, max(shape))
    assert shown.shape[0] / shown.shape[1] == pytest.approx(shape[0] / shape[1], rel=0.01)
    for place in ((0.2, 0.3), (0.8, 0.6)):
        of_shown, of_picture = (
            array[int(place[0] * array.shape[0]), int(place[1] * array.shape[1])] for array in (shown, picture)
        )
        assert abs(of_shown - of_picture).max() < 8


def test_error_maps_are_coloured_by_one_scale() -> None:
    error = np.full((32, 32), 0.1)
    for top in (0.1, 0.2):
        assert abs(decoded(error_url(error, top)) - ember(np.array([[0.1 / top]]))).max() < 12


def test_a_scene_without_test_views_has_no_heading_for_them() -> None:
    nothing = Group("scene", ())
    assert view_cards(nothing, ViewsShown((), 1.0, ()), "views") == ""
    assert "Test views" in view_cards(nothing, ViewsShown((), 1.0, ("its photographs are gone",)), "views")
