"""Whatever a browser sends, the look is one that can be shown."""

import math
import threading

from hypothesis import given
from hypothesis import strategies as st

from ringlight.view.standpoint import Standpoint
from ringlight.view.wishes import ARRANGEMENTS, Ask, Look, Wishes

CHOICES = {"layer": ("color", "depth"), "left": ("a", "b"), "right": ("a", "b"), "arrangement": ARRANGEMENTS}
POINT = Standpoint((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 1.0, 10, 10)

anything = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(),
    st.lists(st.integers()),
    st.sampled_from(["a", "depth"]),
)


@given(
    st.lists(st.tuples(st.sampled_from(["layer", "light", "left", "right", "arrangement", "curtain", "x"]), anything))
)
def test_any_values_leave_a_look_that_can_be_shown(pairs: list):
    wishes = Wishes(Look("a", "b"), CHOICES)
    for field, value in pairs:
        wishes.wish(field, value)
    look = wishes.look
    assert all(getattr(look, field) in choices for field, choices in CHOICES.items())
    assert 0 <= look.light <= 2
    assert 0 <= look.curtain <= 1


def test_good_values_are_taken():
    wishes = Wishes(Look("a", "b"), CHOICES)
    for field, value in (("layer", "depth"), ("light", 0), ("left", "b"), ("curtain", 7)):
        wishes.wish(field, value)
    assert wishes.look == Look("b", "b", layer="depth", light=0.0, curtain=1.0)
    assert wishes.changed.is_set()


def test_a_camera_that_says_the_same_again_has_not_moved():
    wishes = Wishes(Look("a", "b"), CHOICES)
    wishes.stand(1, POINT, 5.0)
    wishes.stand(1, POINT, 6.0)
    wishes.stand(2, Standpoint((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), math.nan, 10, 10), 6.0)
    assert {browser: seen.moved for browser, seen in wishes.browsers.items()} == {1: 5.0}
    wishes.leave(1)
    wishes.leave(1)
    assert wishes.browsers == {}


def test_what_several_threads_ask_is_taken_once():
    wishes, heard = Wishes(Look("a", "b"), CHOICES), []
    threads = [threading.Thread(target=lambda n=n: [wishes.ask(Ask.SAVE, n, i) for i in range(200)]) for n in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        heard += wishes.taken()
    heard += wishes.taken()
    assert len(heard) == len(set(heard)) == 800
    for browser in range(4):
        assert [value for _, who, value in heard if who == browser] == list(range(200))
