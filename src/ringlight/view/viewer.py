"""The viewer: obeys wishes and draws what is due, one picture at a turn.

Whoever owns the models calls :meth:`Viewer.turn` between two steps of training, or again and again. Drawing reads the
models and changes nothing, so a training has the same bits whether or not somebody looks.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ringlight.core.camera import Camera
from ringlight.errors import RinglightError
from ringlight.view.curves import Curves
from ringlight.view.flight import Flight
from ringlight.view.on_disk import Following, OnDisk
from ringlight.view.pacing import MOVING_SHARE, REST_SECONDS, RESTING_SHARE, Pace, Share, next_scale
from ringlight.view.page import Page
from ringlight.view.pictures import Pictures
from ringlight.view.standpoint import looked_at, standpoint_at
from ringlight.view.subject import PHOTOGRAPH, Subject
from ringlight.view.thumbnails import Thumbnails
from ringlight.view.wishes import ALL, ALONE, ARRANGEMENTS, Ask, Look, Seen, Wishes

STATUS_SECONDS = 1.0
"""Between two changes of the status line and the curves."""


@dataclass(frozen=True)
class Shown:
    """What a browser has: drawn where, how, of which state of the models, and with which factor on the window's
    sides; ``trouble`` is why it has no picture, if so."""

    seen: Seen
    look: Look
    state: int
    scale: float
    trouble: str | None = None


@dataclass(frozen=True)
class Trained:
    """What the viewer may ask of a training: the step that it has done, its facts in a line, its curves by its source's
    name; ``save`` writes it and returns the sentence that says so, or raises RinglightError."""

    step: Callable[[], int]
    facts: Callable[[], str]
    curves: Callable[[], Mapping[str, Curves]]
    save: Callable[[], str]


class Viewer:
    """Shows ``subject`` on ``page`` as ``wishes`` say; ``trained`` where it is being trained here. ``files`` are those
    of its models, by their names, that others may write again."""

    def __init__(
        self,
        subject: Subject,
        page: Page,
        wishes: Wishes,
        trained: Trained | None = None,
        now: Callable[[], float] = time.monotonic,
        files: Mapping[str, OnDisk] | None = None,
    ):
        self.page, self.wishes, self.trained = page, wishes, trained
        self.is_paused = False
        self._now = now
        self._pace, self._share = Pace(), Share()
        self._shown: dict[int, Shown] = {}
        self._last = -1
        self._look, self._changed = wishes.look, now()
        self._said, self._told = ("", False), -np.inf
        self._standing: frozenset[tuple[float, float, float]] = frozenset()
        self._thumbnails, self._flight = Thumbnails(subject), Flight(page, subject)
        self._pictures = Pictures(subject)
        self._following, self._times_read = Following(files or {}), 0
        page.curves(self._following.curves)

    @property
    def subject(self) -> Subject:
        """What is looked at now."""
        return self._pictures.subject

    def turn(self) -> bool:
        """Do what was asked, and draw at most one picture; whether there was anything to do."""
        asked = self._obey()
        browsers, now = self.wishes.browsers, self._now()
        self._shown = {browser: shown for browser, shown in self._shown.items() if browser in browsers}
        if not browsers:
            self._flight.stop()
            return asked
        self._follow(browsers, now)
        look = self.wishes.look
        if look != self._look:
            self._look, self._changed = look, now
        moves = self.is_moving
        share = MOVING_SHARE if moves else RESTING_SHARE
        if self._is_training and not self._share.may(now, share):
            return asked
        self._play(now)
        self._hide_cameras(browsers)
        self._tell_facts(now)
        drew = self._draw_next(browsers, look, now)
        drew = (not moves and self._thumbnails.hang_one(self.page)) or drew
        if drew:
            self._share.note(now, self._now())
        return asked or drew

    @property
    def is_moving(self) -> bool:
        """Whether a camera or the look changed just now, so that there will be a finer picture soon."""
        moved = [self._changed, *(seen.moved for seen in self.wishes.browsers.values())]
        return self._flight.plays or self._now() - max(moved) < REST_SECONDS

    def close(self) -> None:
        """End the page's server."""
        self.page.close()

    # What is drawn

    def _draw_next(self, browsers: dict[int, Seen], look: Look, now: float) -> bool:
        """The next browser's, of those whose picture is not what it should be."""
        order = sorted(browsers, key=lambda browser: (browser <= self._last, browser))
        for browser in order:
            seen = browsers[browser]
            scale = self._due(browser, seen, look, now)
            if scale is not None:
                self._last = browser
                self._draw(browser, seen, look, *scale)
                return True
        return False

    def _due(self, browser: int, seen: Seen, look: Look, now: float) -> tuple[float, bool] | None:
        """The factor on the sides of the picture that a browser shall get now, and whether it is the finest; None where
        it has that."""
        before = self._shown.get(browser)
        is_same_view = before is not None and before.seen == seen and before.look == look
        point = seen.standpoint
        rests = now - max(seen.moved, self._changed) >= REST_SECONDS and not self._flight.plays
        have = before.scale if before is not None and is_same_view else None
        is_stale = before is None or before.state != self._state()
        return next_scale(
            self._pace, self._pictures.kind(look), (point.width, point.height), have, is_stale, rests, self._is_training
        )

    def _draw(self, browser: int, seen: Seen, look: Look, scale: float, is_final: bool) -> None:
        begun, state = self._now(), self._state()
        camera, before = seen.standpoint.camera(scale), self._shown.get(browser)
        picture, trouble = None, None
        try:
            picture = self._pictures.picture(camera, look)
        except RinglightError as error:
            trouble = str(error)
            if before is None or before.trouble != trouble:  # else it is told at each turn
                self.page.tell(browser, trouble, is_trouble=True)
        self.page.show(browser, picture, is_final)
        self._pace.note(self._pictures.kind(look), camera.width * camera.height, self._now() - begun)
        self._shown[browser] = Shown(seen, look, state, scale, trouble)

    @property
    def _is_training(self) -> bool:
        return self.trained is not None and not self.is_paused

    def _state(self) -> int:
        """Another number whenever the models have changed."""
        return self._times_read if self.trained is None else self.trained.step()

    # What is asked

    def _obey(self) -> bool:
        asked = self.wishes.taken()
        for what, browser, value in asked:
            try:
                self._do(what, browser, value)
            except RinglightError as error:
                self.page.tell(browser, str(error), is_trouble=True)
        return bool(asked)

    def _do(self, what: Ask, browser: int, value: object) -> None:
        if what in (Ask.PAUSE, Ask.CONTINUE):
            self.is_paused = self.trained is not None and what is Ask.PAUSE
            self._told = -np.inf
        elif what is Ask.SAVE and self.trained is not None:
            self.page.tell(browser, self.trained.save())
        elif what in Flight.asks:
            self._flight.do(what, browser, self.wishes.browsers.get(browser), value, self._now())
        elif what is Ask.GO_TO_VIEW and isinstance(value, str) and value in self.subject.views:
            seen = self.wishes.browsers.get(browser)
            if seen is not None:  # else it was closed since
                self._place(browser, seen, self.subject.views[value])

    def _place(self, browser: int, seen: Seen, camera: Camera) -> None:
        strips = self.wishes.look.strips(len(self.subject.sources))
        point = standpoint_at(camera, seen.standpoint.width, seen.standpoint.height, strips)
        self.page.place(browser, point, looked_at(camera, self.subject.center))

    def _play(self, now: float) -> None:
        """Move the browser that plays to where its film is now."""
        place = self._flight.place(now)
        if place is None:
            return
        browser, camera = place
        seen = self.wishes.browsers.get(browser)
        if seen is None:
            self._flight.stop()
        else:
            self._place(browser, seen, camera)

    def _follow(self, browsers: dict[int, Seen], now: float) -> None:
        """Take what another process has written since."""
        news, curves_changed = self._following.look(now)
        for one in news:
            if not one.is_trouble:
                file = self._following.files[one.name]
                self._pictures.subject = self.subject.with_model(one.name, file.opened.stored.model, file.background)
                self._times_read += 1
                self.page.status(self._following.title, False)
            for browser in browsers:
                self.page.tell(browser, one.sentence, one.is_trouble)
        if curves_changed:
            self.page.curves(self._following.curves)

    def _hide_cameras(self, browsers: dict[int, Seen]) -> None:
        """Those that somebody stands in."""
        standing = frozenset(seen.standpoint.position for seen in browsers.values())
        if standing != self._standing:
            self._standing = standing
            self.page.hide_cameras(self.subject.views_near(np.array(list(standing))))

    def _tell_facts(self, now: float) -> None:
        if self.trained is None or now - self._told < STATUS_SECONDS:
            return
        self._told = now
        said = (self.trained.facts(), self.is_paused)
        if said != self._said:
            self._said = said
            self.page.status(*said)
            self.page.curves(self.trained.curves())


def first_wishes(subject: Subject) -> Wishes:
    """What is shown at first: the first source alone, or all runs; and what can be chosen."""
    shown = subject.sources_shown or (PHOTOGRAPH,)
    second = shown[1] if len(shown) > 1 else shown[0]
    look = Look(shown[0], second, arrangement=ALL if len(subject.sources) > 1 else ALONE)
    return Wishes(look, {"layer": subject.layers, "left": shown, "right": shown, "arrangement": ARRANGEMENTS})
