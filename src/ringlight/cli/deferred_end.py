"""Signals that end work which keeps what it has: one sentence, and the exit code that a shell expects."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ringlight.cli.main import Stopped
from ringlight.cli.signals import signals_to


@contextmanager
def ended_in_order(way_on: str) -> Iterator[None]:
    """Inside the block a signal ends what runs by an exception, so that children and files are put in order; then
    ``way_on`` is said and Stopped raised. One that the parent had ignored stays ignored."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise Stopped(number)

    try:
        with signals_to(stop):
            yield
    except Stopped:
        sys.stderr.write(f"stopped; {way_on}\n")
        raise
