"""Damaged photographs are found before or soon after the first step: each is decoded once, test views among them."""

import time
from collections.abc import Iterator
from threading import Thread

from ringlight.core.scene import Scene, View
from ringlight.core.stages import counted

FIRST_SECONDS = 2.0
"""For which photographs are decoded before anything else happens; those that remain follow beside the training."""


class DecodeCheck:
    """Decodes all photographs of a scene: test views first, which training would not, and these are not kept.

    Raises:
        SceneError: a photograph is damaged, and was met within the first ``seconds``.
    """

    def __init__(self, scene: Scene, seconds: float = FIRST_SECONDS):
        self._error: Exception | None = None
        begun = time.process_time()
        views = [*((view, False) for view in scene.test), *((view, True) for view in scene.train)]
        self._left = counted("decoding photographs", views)
        until = time.monotonic() + seconds
        self._thread: Thread | None = None
        is_done = False
        while not is_done and time.monotonic() < until:
            is_done = not _decode_next(self._left)
        self.cpu_seconds = time.process_time() - begun
        """That this took, before the first step."""
        if not is_done:
            self._thread = Thread(target=self._decode_others, name="photographs", daemon=True)
            self._thread.start()

    def refuse_damaged(self) -> None:
        """Raise SceneError once it is known that a photograph is damaged; never waits."""
        if self._error is not None:
            raise self._error

    def wait(self) -> None:
        """Until all photographs are decoded, or one is found damaged."""
        if self._thread is not None:
            self._thread.join()

    def _decode_others(self) -> None:
        try:
            while _decode_next(self._left):
                pass
        except Exception as error:  # raised where the training asks
            self._error = error


def _decode_next(views: Iterator[tuple[View, bool]]) -> bool:
    """Whether there was another one."""
    view, is_kept = next(views, (None, False))
    if view is None:
        return False
    if is_kept:
        view.load()
    else:
        view.refuse_damaged()
    return True
