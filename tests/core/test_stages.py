"""Whoever listens hears how far work is, and nobody has to."""

import threading

from ringlight.core.command_line import command
from ringlight.core.stages import counted, heard_by, tell
from ringlight.core.words import counted as spoken


def test_every_item_is_told_of_as_it_is_done():
    heard = []
    with heard_by(lambda *stage: heard.append(stage)):
        for item in counted("carving", "ab"):
            heard.append(item)
        tell("reading")
    tell("nobody hears this")
    assert heard == [("carving", 0, 2), "a", ("carving", 1, 2), "b", ("carving", 2, 2), ("reading", 0, 0)]


def test_without_a_listener_the_items_are_the_same():
    assert list(counted("carving", [3, 1, 2])) == [3, 1, 2]


def test_another_thread_is_not_heard():
    heard = []
    with heard_by(lambda *stage: heard.append(stage)):
        other = threading.Thread(target=tell, args=("elsewhere",))
        other.start()
        other.join()
    assert heard == []


def test_an_inner_listener_is_followed_by_the_outer_one():
    outer, inner = [], []
    with heard_by(lambda stage, *_: outer.append(stage)):
        with heard_by(lambda stage, *_: inner.append(stage)):
            tell("one")
        tell("two")
    assert (outer, inner) == (["two"], ["one"])


def test_commands_are_quoted_for_the_shell():
    assert command("render", "runs/my photos; rm -r ~") == "ringlight render 'runs/my photos; rm -r ~'"
    assert command("eval", "runs/plain") == "ringlight eval runs/plain"


def test_one_is_no_plural():
    assert [spoken(number, "step") for number in (0, 1, 3000)] == ["0 steps", "1 step", "3,000 steps"]
