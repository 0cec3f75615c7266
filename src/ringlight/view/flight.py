"""What is asked of key frames: more or fewer of them, a preview in a browser, and the file for ``ringlight render``."""

from collections.abc import Sequence

import numpy as np

from ringlight.core.camera import Camera
from ringlight.core.command_line import command
from ringlight.view.key_frames import FILES, FPS, STOPS, Keys
from ringlight.view.page import Page
from ringlight.view.subject import Subject
from ringlight.view.wishes import Ask, Seen

NO_KEYS = "there is no key frame yet; add some where the camera shall pass"


class Flight:
    """Of one viewer: all browsers share the key frames, and one of them has the preview."""

    asks = frozenset({Ask.ADD_KEY, Ask.DROP_KEY, Ask.PLAY, Ask.STOP, Ask.WRITE_PATH})
    """What :meth:`do` takes."""

    def __init__(self, page: Page, subject: Subject):
        self.page, self.home, self.film_of = page, subject.home, subject.film_of
        self.keys = Keys()
        self._film: tuple[int, list[Camera], float] | None = None

    @property
    def plays(self) -> bool:
        """Whether a browser is under way."""
        return self._film is not None

    def do(self, what: Ask, browser: int, seen: Seen | None, value: object, now: float) -> None:
        """One of :attr:`asks`; ``seen`` is where the browser stands, None where it was closed since. Raises
        OutputError."""
        if what is Ask.STOP:
            self.stop()
        elif what is Ask.WRITE_PATH:
            self._write(browser, value)
        elif what is Ask.DROP_KEY:
            self.keys.drop()
            self.page.keys(self.keys.cameras, self.keys.way())
        elif seen is not None and what is Ask.ADD_KEY:
            self.keys.add(seen.standpoint.camera())
            self.page.keys(self.keys.cameras, self.keys.way())
        elif seen is not None:
            film = self.keys.film(_seconds(value))
            self._film = (browser, film, now) if film else None
            if not film:
                self.page.tell(browser, NO_KEYS)

    def stop(self) -> None:
        """End the preview."""
        self._film = None

    def place(self, now: float) -> tuple[int, Camera] | None:
        """The browser that is under way, and where it is now: the end is the last."""
        if self._film is None:
            return None
        browser, film, begun = self._film
        frame = int((now - begun) * FPS)
        if frame >= len(film):
            frame, self._film = len(film) - 1, None
        return browser, film[frame]

    def _write(self, browser: int, value: object) -> None:
        if not self.keys.cameras:
            self.page.tell(browser, NO_KEYS)
            return
        seconds, holds = value if isinstance(value, Sequence) and len(value) == 2 else (value, STOPS)
        path = self.keys.write(self.home, _seconds(seconds), holds if holds in FILES else STOPS)
        render = "" if self.film_of is None else f"; render it with: {command('render', self.film_of, '--path', path)}"
        self.page.tell(browser, f"written to {path}{render}")


def _seconds(value: object) -> float:
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else 0.0
