"""Signals that end work which keeps what it has: one sentence, and the exit code that a shell expects."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ringlight.cli.main import Stopped
from ringlight.cli.run_training import STOPPING


@contextmanager
def ended_in_order(way_on: str) -> Iterator[None]:
    """Inside the block a signal ends what runs by an exception, so that children and files are put in order; then
    ``way_on`` is said and Stopped raised. One that the parent had ignored stays ignored."""

    def stop(number: int, frame: object) -> None:
        raise Stopped(number)

    heard = [number for number in STOPPING if signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, stop) for number in heard}
    try:
        yield
    except Stopped:
        sys.stderr.write(f"stopped; {way_on}\n")
        raise
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
