"""torch's work in pieces that do not depend on each other, on as many threads as the kernels have.

torch itself has one thread, so that its bits depend on none (``cli/threads.py``): each piece has the bits that it has
alone.
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

from ringlight import _kernels

Found = TypeVar("Found")


def side_by_side(pieces: Sequence[Callable[[], Found]], device: torch.device) -> list[Found]:
    """What the pieces return, in their order; none of them records a graph. On another ``device`` than a CPU they only
    ask for work, one after another."""
    if device.type != "cpu" or min(_kernels.threads(), len(pieces)) <= 1:
        return [_without_graph(piece) for piece in pieces]
    return list(_pool(_kernels.threads()).map(_without_graph, pieces))


def _without_graph(piece: Callable[[], Found]) -> Found:
    with torch.no_grad():  # each thread has a switch of its own
        return piece()


@functools.lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    # A new thread of torch takes the number of its threads when that is asked for, and all cores before.
    return ThreadPoolExecutor(threads, "torch", initializer=torch.get_num_threads)
