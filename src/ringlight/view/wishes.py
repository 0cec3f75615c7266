"""What people at browsers want to see and to happen: written by the server's thread, read between drawings.

Nothing is drawn or changed when a wish is made, so that models need no locks.
"""

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from ringlight.files.layer_pictures import COLOR
from ringlight.view.model_picture import BRIGHTEST
from ringlight.view.standpoint import Standpoint


class Ask(Enum):
    """What is done once, with a value where it says so."""

    PAUSE = "pause"
    CONTINUE = "continue"
    SAVE = "save"
    GO_TO_VIEW = "go"
    """Name of a view."""
    ADD_KEY = "add a key frame"
    DROP_KEY = "drop the last key frame"
    PLAY = "preview the path"
    """Seconds that the film takes."""
    STOP = "stop the preview"
    WRITE_PATH = "write the path"
    """Seconds that the film takes."""


ALONE, CURTAIN, BESIDE, ALL = "alone", "curtain", "side by side", "all runs"
ARRANGEMENTS = (ALONE, CURTAIN, BESIDE, ALL)

RANGES = {"light": (0.0, BRIGHTEST), "curtain": (0.0, 1.0)}
"""Of the look's numbers."""


@dataclass(frozen=True)
class Look:
    """What all browsers show: ``layer``; ``light``, the factor on what depends on the view; how the sources ``left``
    and ``right`` are arranged, and at which share of the width a ``curtain`` hangs."""

    left: str
    right: str
    layer: str = COLOR
    light: float = 1.0
    arrangement: str = ALONE
    curtain: float = 0.5

    def strips(self, runs: int) -> int:
        """Parts beside each other into which the window is cut, each with a view of its own, of so many ``runs``."""
        return {BESIDE: 2, ALL: max(runs, 1)}.get(self.arrangement, 1)


@dataclass(frozen=True)
class Seen:
    """A browser's camera, and the second of its last move."""

    standpoint: Standpoint
    moved: float


class Wishes:
    """All that was asked for since, safe to be used by several threads."""

    def __init__(self, look: Look, choices: Mapping[str, Sequence[str]]):
        """``choices`` are what a field of the look can be, by its name."""
        self._choices = choices
        self._lock = threading.Lock()
        self._look = look
        self._browsers: dict[int, Seen] = {}
        self._asked: deque[tuple[Ask, int, Any]] = deque()
        self.changed = threading.Event()
        """Set by every wish; whoever waits for it clears it first."""

    @property
    def look(self) -> Look:
        """What shall be shown now."""
        with self._lock:
            return self._look

    def wish(self, field: str, value: object) -> None:
        """Change a field of the look. What comes from a browser is anything: a value that makes no sense is passed
        over."""
        if field in RANGES:
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                return
            low, high = RANGES[field]
            value = min(max(float(value), low), high)
        elif not isinstance(value, str) or value not in self._choices.get(field, ()):
            return
        changed: Any = {field: value}
        with self._lock:
            self._look = replace(self._look, **changed)
        self.changed.set()

    def stand(self, browser: int, standpoint: Standpoint, now: float) -> None:
        """A browser has come, or its camera has moved; one that is not usable is as good as none."""
        with self._lock:
            before = self._browsers.get(browser)
            if standpoint.is_usable and (before is None or before.standpoint != standpoint):
                self._browsers[browser] = Seen(standpoint, now)
        self.changed.set()

    def leave(self, browser: int) -> None:
        """A browser was closed."""
        with self._lock:
            self._browsers.pop(browser, None)
        self.changed.set()

    @property
    def browsers(self) -> dict[int, Seen]:
        """Those that are open."""
        with self._lock:
            return dict(self._browsers)

    def ask(self, what: Ask, browser: int, value: Any = None) -> None:
        """Once, for ``browser``."""
        with self._lock:
            self._asked.append((what, browser, value))
        self.changed.set()

    def taken(self) -> list[tuple[Ask, int, Any]]:
        """What was asked since the last call, in order."""
        with self._lock:
            asked = list(self._asked)
            self._asked.clear()
        return asked
