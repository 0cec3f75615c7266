"""Signals that end a command, kept until it can end well."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, an orderly kill, and a terminal or connection that is closed; Windows has no SIGHUP."""


@contextmanager
def signals_to(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Inside the block they go to ``handler``, but for those that the parent had ignored (nohup, a job in the
    background), which stay ignored."""
    heard = [number for number in STOPPING if signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, handler) for number in heard}
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


def signal_of(interruption: KeyboardInterrupt) -> int:
    """Its number: one that Python or a library raises has none, and is Ctrl-C's."""
    number, *_ = [*interruption.args, signal.SIGINT]
    return number if isinstance(number, int) else signal.SIGINT


def interrupt(number: int, frame: FrameType | None) -> None:
    """Ends what runs as Ctrl-C does, in order, whichever signal it was. Who ends a service or closes a terminal sends
    several: after one, only Ctrl-C ends what is put in order too."""
    if number != signal.SIGINT:
        for other in STOPPING:
            if other != signal.SIGINT:
                signal.signal(other, signal.SIG_IGN)
    raise KeyboardInterrupt(number)


def nothing(number: int, before: list[int]) -> None:
    """What is done besides keeping a signal's number, unless something is asked for."""


@contextmanager
def kept_signals(hear: Callable[[int, list[int]], None] = nothing) -> Iterator[list[int]]:
    """Inside the block a signal only leaves its number, after ``hear`` got it and those before it."""
    numbers: list[int] = []

    def keep(number: int, frame: FrameType | None) -> None:
        before = numbers.copy()
        numbers.append(number)  # first, for another may come while this one is told of
        hear(number, before)

    with signals_to(keep):
        yield numbers
