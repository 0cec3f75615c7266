"""torch's work in pieces that do not depend on each other, by as many threads as the kernels have.

torch itself has one thread, so that its bits depend on none (``cli/threads.py``): whoever does a piece, it has the same
bits.
"""

import functools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TypeVar

import torch

from ringlight import _kernels

Found = TypeVar("Found")


def each_of(pieces: Sequence[Callable[[], Found]], device: torch.device) -> Iterator[Found]:
    """What the pieces return, in their order; none records a graph.

    One more than there are threads are under way or wait to be taken, so that no more results than that are in memory.
    On another ``device`` than a CPU, and where the system gives no threads, the caller does one after another. A piece
    may not ask for pieces of its own. All that were begun have ended when an error leaves this.
    """
    threads = _kernels.threads()
    shares = device.type == "cpu" and min(threads, len(pieces)) > 1
    pool = _pool(threads, torch.get_num_threads(), "pieces") if shares else None
    done = functools.partial(_done, torch.is_inference_mode_enabled())
    if pool is None:
        yield from map(done, pieces)
        return
    begun: deque[Future[Found]] = deque()
    try:
        for piece in pieces:
            begun.append(pool.submit(done, piece))
            if len(begun) > threads:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
    finally:
        wait(begun)


def do_all(pieces: Sequence[Callable[[], object]], device: torch.device) -> None:
    """The same of pieces that return nothing."""
    for _ in each_of(pieces, device):
        pass


def both(one: Callable[[], Found], other: Callable[[], Found], device: torch.device) -> tuple[Found, Found]:
    """What the two return; at once where there are threads, so that what one does alone goes on beside the other's
    pieces. They may ask for pieces, not for two of their own. Both have ended when an error leaves this."""
    shares = device.type == "cpu" and _kernels.threads() > 1
    pool = _pool(1, torch.get_num_threads(), "beside") if shares else None
    if pool is None:
        return one(), other()
    begun = pool.submit(_done, torch.is_inference_mode_enabled(), other)
    try:
        found = one()
    finally:
        wait([begun])
    return found, begun.result()


def _done(inference: bool, piece: Callable[[], Found]) -> Found:
    with torch.inference_mode(inference), torch.no_grad():  # each thread has switches of its own
        return piece()


@functools.lru_cache(maxsize=2)
def _pool(threads: int, torch_threads: int, name: str) -> ThreadPoolExecutor | None:
    """With all its threads; None where the system does not give them."""
    # A new thread of torch has all cores until it is asked how many it has: then it takes what the others have.
    pool = ThreadPoolExecutor(threads, name, initializer=torch.get_num_threads)
    started = threading.Barrier(threads)
    try:
        for begun in [pool.submit(started.wait) for _ in range(threads)]:
            begun.result()
    except RuntimeError:
        started.abort()
        pool.shutdown(wait=False)
        return None
    return pool


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has no thread but its own
