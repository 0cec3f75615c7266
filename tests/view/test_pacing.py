"""Pictures are as large as their time allows, and no more often than their share."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ringlight.view.pacing import (
    LEAST_SIDE,
    MOST_SIDE,
    MOVING_SECONDS,
    Pace,
    Share,
    largest_scale,
    least_scale,
    next_scale,
)

SIZE = (1280, 800)


@given(st.floats(0, 0.05), st.floats(1e-9, 1e-6))
def test_the_size_settles_where_a_moving_picture_takes_its_time(fixed: float, each: float):
    pace, (width, height) = Pace(), SIZE

    def cost(pixels: float) -> float:
        return fixed + each * pixels

    for _ in range(30):
        scale = pace.scale("kind", MOVING_SECONDS, width, height)
        pixels = round(width * scale) * round(height * scale)
        pace.note("kind", pixels, cost(pixels))
    assert least_scale(*SIZE) <= scale <= largest_scale(*SIZE)
    if least_scale(*SIZE) < scale < 1:
        assert cost(pixels) == pytest.approx(MOVING_SECONDS, rel=0.2)
    elif scale == 1:
        assert cost(width * height) <= 1.2 * MOVING_SECONDS


def test_the_first_picture_is_the_smallest_and_kinds_are_apart():
    pace = Pace()
    assert pace.scale("new", MOVING_SECONDS, *SIZE) * SIZE[0] == pytest.approx(LEAST_SIDE)
    pace.note("fast", 1000, 1e-6)
    assert pace.scale("fast", MOVING_SECONDS, *SIZE) == 1
    assert pace.scale("new", MOVING_SECONDS, *SIZE) < 1


def test_a_huge_window_gets_a_picture_of_bounded_size():
    pace = Pace()
    pace.note("fast", 1000, 1e-9)
    assert pace.scale("fast", MOVING_SECONDS, 100_000, 50) * 100_000 == pytest.approx(MOST_SIDE)
    assert least_scale(3, 2) == 1


def test_a_resting_camera_is_refined_step_by_step_and_then_left_alone():
    pace, have, sides = Pace(), None, []
    while (found := next_scale(pace, "kind", SIZE, have, have is None, True, False)) is not None:
        have, is_final = found
        sides.append(have)
        pace.note("kind", round(SIZE[0] * SIZE[1] * have**2), 2.0)
        assert len(sides) < 20
    assert is_final
    assert sides == sorted(sides)
    assert sides[-1] == 1
    assert max(after / before for before, after in pairwise(sides)) <= 2.0001


def test_a_moving_camera_gets_no_second_picture_of_one_view():
    assert next_scale(Pace(), "kind", SIZE, 0.3, False, False, False) is None


def test_a_model_that_trains_gets_pictures_of_bounded_cost():
    pace = Pace()
    for pixels in (10_000, 100_000):
        pace.note("kind", pixels, 1e-5 * pixels)
    scale, is_final = next_scale(pace, "kind", SIZE, 1.0, True, True, True) or (0, False)
    assert is_final
    assert 1e-5 * scale**2 * SIZE[0] * SIZE[1] == pytest.approx(0.25, rel=0.01)
    assert next_scale(pace, "kind", SIZE, scale, False, True, True) is None


@given(st.floats(0.02, 0.9), st.lists(st.floats(1e-4, 1), min_size=3, max_size=30))
def test_no_more_than_its_share_of_the_time_goes_to_pictures(part: float, costs: list[float]):
    share, now, spent = Share(), 0.0, 0.0
    for cost in costs:
        while not share.may(now, part):
            now += max(0.05 * spent, 1e-5)
        share.note(now, now + cost)
        now, spent = now + cost, spent + cost
    while not share.may(now, part):
        now += 0.05 * spent
    assert spent / now <= part * 1.0001
