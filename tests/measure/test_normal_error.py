"""Angles between normals: against the obvious way, and against NumPy's median."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzz import fuzzed
from ringlight.measure.normal_error import STEP, AngleSums, ComparedNormals, angles_between, compare_normals, score_of
from true_normals_file import turned

UP = np.array([0.0, 0.0, 1.0])


def view_of(angles: np.ndarray) -> ComparedNormals:
    """A view whose normals have these angles to the true ones."""
    truth = np.broadcast_to(UP, (*angles.shape, 3)).copy()
    radians = np.radians(angles)
    normals = np.stack([np.sin(radians), np.zeros_like(radians), np.cos(radians)], -1)
    return compare_normals(normals, np.ones((*angles.shape, 1)), truth)


@fuzzed
@given(seed=st.integers(0, 2**32 - 1), degrees=st.floats(0, 180))
def test_a_normal_that_is_turned_is_as_far_away(seed: int, degrees: float) -> None:
    normals = np.random.default_rng(seed).standard_normal((3, 4, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    assert angles_between(normals * 3, turned(normals, degrees) * 0.2) == pytest.approx(degrees, abs=2e-6)


@fuzzed
@given(seed=st.integers(0, 2**32 - 1))
def test_angles_are_the_arc_cosines(seed: int) -> None:
    one, other = np.random.default_rng(seed).standard_normal((2, 5, 3))
    for a, b, angle in zip(one, other, angles_between(one, other), strict=True):
        cosine = math.fsum(a * b) / math.sqrt(math.fsum(a * a) * math.fsum(b * b))
        assert angle == pytest.approx(math.degrees(math.acos(cosine)), abs=1e-4)


@fuzzed
@given(views=st.lists(st.lists(st.floats(0, 180), min_size=1, max_size=30), min_size=1, max_size=4))
def test_measures_are_those_of_all_pixels_together(views: list[list[float]]) -> None:
    sums = AngleSums()
    for angles in views:
        sums.add(view_of(np.array([angles])))
    score, together = sums.score(), np.concatenate(views)
    assert score.mean == pytest.approx(together.mean(), abs=1e-6)
    assert score.median == pytest.approx(np.median(together), abs=STEP / 2 + 1e-6)
    bound = np.abs(together - 11.25) > 1e-9  # what is nearer is a matter of rounding
    assert score.within_11_25 == pytest.approx((together < 11.25).mean(), abs=1 - bound.mean() + 1e-12)
    assert (score.compared, score.pixels) == (1.0, len(together))


def test_only_pixels_that_both_show_count() -> None:
    normals = np.tile(UP, (1, 6, 1))
    alpha = np.array([0.0, 0.49, 0.5, 1.0, 1.0, 1.0])[None, :, None]
    truth = np.tile(UP, (1, 6, 1))
    normals[0, 3] = 0
    truth[0, 4] = 0
    normals[0, 5] = np.nan
    view = compare_normals(normals, alpha, truth)
    assert np.isfinite(view.angles).tolist() == [[False, False, True, False, False, False]]
    score = score_of(view)
    assert (score.pixels, score.compared) == (5, 0.2)
    assert score.mean == 0


def test_where_nothing_can_be_compared_there_is_no_number() -> None:
    for truth in (np.tile(UP, (2, 2, 1)), np.zeros((2, 2, 3))):
        score = score_of(compare_normals(np.zeros((2, 2, 3)), np.ones((2, 2, 1)), truth))
        assert (score.mean, score.median, score.within_11_25, score.compared) == (None, None, None, 0.0)
