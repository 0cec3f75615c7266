"""What is under way, for whoever listens: loading, a trial, a surface that is carved.

Progress passes through floors that need not know of it, as warnings do: no signature carries it, nobody has to listen,
and no number depends on it.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")

Listener = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and how much there is in all; 0 where that is not known."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Inside the block ``listener`` hears of every stage, of this thread."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(stage: str, done: int = 0, total: int = 0) -> None:
    """Say what is under way."""
    listener = _listener.get()
    if listener is not None:
        listener(stage, done, total)


def counted(stage: str, items: Sequence[Item]) -> Iterator[Item]:
    """The items, one by one; each is done when the next is asked for."""
    tell(stage, 0, len(items))
    for done, item in enumerate(items, 1):
        yield item
        tell(stage, done, len(items))
