"""The choice of views and boxes: the largest difference, always the same, whatever the order of views."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from samples import picture

from ringlight.errors import RunError
from ringlight.measure.disagreement import choose_box, choose_views, difference_map

TRUTH = {name: torch.full((12, 16, 3), 0.5) for name in ("a", "b", "c", "d")}


def shifted(**amounts):
    """The truth, with some views made brighter."""
    return {name: image + amounts.get(name, 0.0) for name, image in TRUTH.items()}


def test_views_come_most_different_first_and_ties_by_name():
    chosen = choose_views([shifted(c=0.2, b=0.1), shifted()], TRUTH, 3)
    assert chosen == ["c", "b", "a"]


def test_what_all_methods_get_wrong_alike_is_no_difference():
    assert choose_views([shifted(d=0.3, b=0.01), shifted(d=0.3)], TRUTH, 1) == ["b"]


def test_a_single_method_is_held_against_the_truth():
    assert choose_views([shifted(d=-0.3)], TRUTH, 1) == ["d"]


def test_the_order_of_views_does_not_matter():
    backwards = dict(reversed(TRUTH.items()))
    columns = [shifted(c=0.2), shifted(a=0.2)]
    assert choose_views(columns, TRUTH, 2) == choose_views(columns, backwards, 2)


def test_only_views_that_all_have_are_chosen():
    partial = {name: image for name, image in shifted(a=0.5).items() if name != "a"}
    assert choose_views([shifted(), partial], TRUTH, 4) == ["b", "c", "d"]
    with pytest.raises(RunError, match="no test picture in common"):
        choose_views([{}], TRUTH, 1)


def test_pictures_of_different_size_are_refused():
    with pytest.raises(RunError, match=r"view a.*30x20, 16x12"):
        choose_views([TRUTH], {"a": picture(20, 30)}, 1)


def test_undefined_pixels_are_drawn_black():
    broken = torch.full((4, 4, 3), float("nan"))
    assert difference_map([broken, torch.ones(4, 4, 3)], torch.ones(4, 4, 3)).tolist() == [[1.0] * 4] * 4


@given(st.integers(0, 11), st.integers(0, 15), st.integers(1, 20), st.integers(1, 20))
def test_the_box_holds_the_difference_and_stays_inside(row, column, width, height):
    difference = np.zeros((12, 16))
    difference[row, column] = 1
    box = choose_box(difference, width, height)
    assert 0 <= box.left <= column < box.left + box.width <= 16
    assert 0 <= box.top <= row < box.top + box.height <= 12


def test_the_box_is_the_best_of_all():
    difference = np.random.default_rng(0).random((12, 16))
    box = choose_box(difference, 5, 3)
    corners = itertools.product(range(10), range(12))
    sums = {(top, left): difference[top : top + 3, left : left + 5].sum() for top, left in corners}
    assert (box.top, box.left) == max(sums, key=lambda corner: sums[corner])
