"""Sizes on the sheet: bounded, in proportion, small pictures enlarged by whole factors."""

from hypothesis import given
from hypothesis import strategies as st

from ringlight.measure.sheet_layout import GAP, INNER_GAP, MARGIN, MAX_SIDE, MAX_WIDTH, Panel, box_size, panel

SIDES = st.integers(16, 4000)


@given(SIDES, SIDES, st.integers(2, 12))
def test_a_sheet_is_never_wider_than_allowed(width, height, columns):
    shown = panel(width, height, columns)
    assert max(shown.width, shown.height) <= MAX_SIDE
    assert 2 * MARGIN + columns * shown.width + (columns - 1) * GAP <= MAX_WIDTH


@given(SIDES, SIDES, st.integers(2, 12))
def test_proportions_are_kept(width, height, columns):
    shown = panel(width, height, columns)
    scale = max(shown.width, shown.height) / max(width, height)
    assert abs(shown.width - scale * width) <= 1
    assert abs(shown.height - scale * height) <= 1
    assert 2 * shown.half[0] + INNER_GAP <= max(shown.width, INNER_GAP + 2)


@given(SIDES, SIDES, st.integers(2, 12))
def test_the_box_is_part_of_the_picture_and_enlarged(width, height, columns):
    shown = panel(width, height, columns)
    box_width, box_height = box_size(shown, width)
    assert 1 <= box_width <= min(shown.half[0], width)
    assert 1 <= box_height <= max(shown.half[1], 1)
    # On the sheet the box is shown larger than it is in the full view.
    assert shown.half[0] / box_width >= min(shown.width / width, 1)


def test_sizes_of_the_scenes_we_know():
    assert panel(200, 200, 3) == Panel(400, 400)
    assert panel(400, 400, 4) == Panel(400, 400)
    assert panel(976, 541, 3) == Panel(640, 355)
    assert panel(800, 800, 3) == Panel(640, 640)
