"""When a run writes a checkpoint."""

import time
from collections.abc import Callable

FIRST_SECONDS = 10.0
"""Until the first checkpoint: what came before is repeated sooner than missed."""

SAVE_SECONDS = 60.0
"""Between two checkpoints: what a run may lose."""

LARGEST_SAVE_SHARE = 0.01
"""Of the time may go into saving: where a checkpoint takes longer, they become rarer."""

LONGEST_PAUSE = 600.0
"""But no rarer than this: on a disk so slow a run would lose too much."""


class Saver:
    """Calls ``save`` every so often: every ``seconds``, or without them after :data:`FIRST_SECONDS`, and then by
    :data:`SAVE_SECONDS` and its share."""

    def __init__(self, save: Callable[[], None], seconds: float | None):
        self.save, self.seconds = save, seconds
        self.pause = FIRST_SECONDS if seconds is None else seconds
        self.begun = self.last = time.monotonic()
        self.spent = 0.0

    def save_if_due(self) -> None:
        """Save if the pause is over. Raises OutputError."""
        begun = time.monotonic()
        if begun - self.last < self.pause:
            return
        self.save()
        self.last = time.monotonic()
        self.spent += self.last - begun
        if self.seconds is None:
            # So that with the next, and one when the run ends, its share is kept in the time since the run began.
            due = (self.spent + 2 * (self.last - begun)) / LARGEST_SAVE_SHARE
            self.pause = min(max(SAVE_SECONDS, self.begun + due - self.last), LONGEST_PAUSE)
