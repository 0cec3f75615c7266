"""How fine a mirror's maps are is said by the user, or left open."""

from ringlight.shade.reflection_settings import FINE_LEVELS, USUAL_LEVELS, ReflectionSettings


def test_what_is_left_open_is_decided_once():
    free = ReflectionSettings(hidden=32)
    assert free.sides == USUAL_LEVELS
    decided = free.for_levels(FINE_LEVELS)
    assert decided.sides == FINE_LEVELS
    assert decided.for_levels(USUAL_LEVELS) == decided
    assert decided.left_to_photographs() == free


def test_maps_that_no_photograph_asks_for_were_given():
    given = ReflectionSettings(levels=(8, 16))
    assert given.left_to_photographs() == given.for_levels(FINE_LEVELS) == given
    assert given.sides == (8, 16)
