"""How large a picture may be, and when the next may be drawn: by what pictures cost so far."""

import math
from collections import defaultdict, deque
from collections.abc import Hashable

import numpy as np

MOVING_SECONDS = 0.08
"""For a picture while the camera moves: a dozen a second still read as motion."""

TRAINING_SECONDS = 0.25
"""For a picture of a model that is being trained, while the camera rests: with RESTING_SHARE there is a new one every
six seconds at least."""

COARSER = 0.2
"""Share of the sides by which a picture may be coarser than what its cost, which is a guess, would allow."""

REST_SECONDS = 0.25
"""Without a move, after which a camera rests."""

LEAST_SIDE = 64
"""Pixels of a picture's longer side, however slow: below this nothing can be made out."""

MOST_SIDE = 2048
"""Pixels of its longer side, however large the window."""

FINER = 2.0
"""Factor on the sides from one picture of a resting camera to the next, so that a camera that moves again is never far
behind."""

MOVING_SHARE = 0.5
"""Of the time of a training that goes to pictures while somebody moves."""

RESTING_SHARE = 0.03
"""The same while all cameras rest. What they cost besides (sending, the server's thread) is not counted: the whole
stays well below a tenth (tests/view/resting_cost.py)."""

SAMPLES = 8
"""Pictures of a kind by which its cost is estimated: a model that grows is followed."""


class Pace:
    """What pictures of each kind cost: a fixed part, and one in proportion to the pixels."""

    def __init__(self) -> None:
        self._samples: dict[Hashable, deque[tuple[int, float]]] = defaultdict(lambda: deque(maxlen=SAMPLES))

    def note(self, kind: Hashable, pixels: int, seconds: float) -> None:
        """A picture of ``kind`` took so long."""
        self._samples[kind].append((pixels, seconds))

    def scale(self, kind: Hashable, wanted: float, width: int, height: int) -> float:
        """Factor in (0, 1] on the sides of a picture of a window that shall take ``wanted`` seconds."""
        samples = self._samples[kind]
        least = least_scale(width, height)
        if not samples:
            return least
        pixels, seconds = np.array(samples, dtype=np.float64).T
        spread = float(((pixels - pixels.mean()) ** 2).sum())
        slope = float(((pixels - pixels.mean()) * (seconds - seconds.mean())).sum()) / spread if spread > 0 else 0.0
        if slope <= 0:  # one size so far, or noise: all of it in proportion
            slope = max(float(seconds.mean() / pixels.mean()), 1e-12)
        fixed = max(float(seconds.mean() - slope * pixels.mean()), 0.0)
        # Where the fixed part takes all the time, few pixels save little.
        room = max(wanted - fixed, wanted / 4)
        return min(max(math.sqrt(room / slope / (width * height)), least), largest_scale(width, height))


def least_scale(width: int, height: int) -> float:
    """Factor on the sides of the smallest picture."""
    return min(LEAST_SIDE / max(width, height), 1.0)


def largest_scale(width: int, height: int) -> float:
    """Factor on the sides of the finest picture."""
    return min(MOST_SIDE / max(width, height), 1.0)


class Share:
    """Bounds the share of the time that goes to pictures."""

    def __init__(self) -> None:
        self._ended, self._spent = -math.inf, 0.0

    def may(self, now: float, share: float) -> bool:
        """Whether the pause after what was spent last is long enough for ``share``, in (0, 1]."""
        return now >= self._ended + self._spent * (1 / share - 1)

    def note(self, begun: float, ended: float) -> None:
        """Pictures were drawn between these seconds."""
        self._ended, self._spent = ended, ended - begun


def next_scale(
    pace: Pace, kind: Hashable, size: tuple[int, int], have: float | None, is_stale: bool, rests: bool, trains: bool
) -> tuple[float, bool] | None:
    """Factor on the sides of the next picture of a window of ``size`` pixels, and whether it is the finest there will
    be; None where none is due.

    ``have`` is the factor of the window's picture of this view, None without one; it ``is_stale`` where the model has
    changed since. The camera ``rests``, or not; a model that ``trains`` gets pictures of bounded cost.
    """
    width, height = size
    if have is None:
        scale = pace.scale(kind, MOVING_SECONDS, width, height)
        return scale, scale == largest_scale(width, height)
    if not rests:
        return None if not is_stale else (have, False)
    finest = pace.scale(kind, TRAINING_SECONDS, width, height) if trains else largest_scale(width, height)
    if have < finest * (1 - COARSER if trains else 1):
        scale = min(FINER * have, finest)
        return scale, scale == finest
    return (finest, True) if is_stale else None
