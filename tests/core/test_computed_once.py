"""A property that is worked out once, without a lock."""

import os
import threading
from pathlib import Path

import pytest

import ringlight
from ringlight.core.computed_once import computed_once


class Counted:
    """Counts how often its value is worked out."""

    def __init__(self) -> None:
        self.times = 0

    @computed_once
    def value(self) -> int:
        """How often."""
        self.times += 1
        return self.times


def test_it_is_worked_out_once_for_each_object():
    first, second = Counted(), Counted()
    assert (first.value, first.value, second.value) == (1, 1, 1)
    assert (Counted.value.__doc__, Counted.value.__class__) == ("How often.", computed_once)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12 warns of forks beside threads
def test_a_process_forked_while_another_thread_works_one_out_does_not_wait():
    entered, left = threading.Event(), threading.Event()

    class Slow:
        @computed_once
        def value(self) -> int:
            if os.getpid() == parent:
                entered.set()
                left.wait(60)
            return 1

    parent = os.getpid()
    busy = threading.Thread(target=lambda: Slow().value)
    busy.start()
    entered.wait(60)
    child = os.fork()
    if child == 0:
        os._exit(0 if Slow().value == 1 else 1)
    left.set()
    busy.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_nothing_in_the_package_uses_the_locked_one():
    sources = Path(ringlight.__file__).parent.rglob("*.py")
    imports = [path.name for path in sources if "import cached_property" in path.read_text(encoding="utf-8")]
    assert imports == []
