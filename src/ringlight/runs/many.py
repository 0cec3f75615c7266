"""Many runs, wherever they are done: as many at a time as there are places. None that fails stops another, but those
that wait for it."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

from ringlight.errors import BackendError, RinglightError

POLL_SECONDS = 0.25
"""Between two looks at what has happened, and at the keyboard."""

MOST_LOSSES = 3
"""Workers that may die with one run before it is given up: it may be the run that kills them."""

STOPPED = "stopped"
"""Begins the reason of a run that a signal ended after it saved, or before there was anything to save."""


@dataclass(frozen=True)
class Happened:
    """Something that a person may want to know of the run ``name``, or of none.

    ``at``: ``facts`` has its step, steps, PSNR in dB and count. ``ended``: ``reason`` says why it failed, or is None.
    ``lost``: where it was done is gone, ``reason`` says so. ``told``: ``reason`` is a sentence.
    """

    kind: Literal["began", "at", "ended", "lost", "told"]
    name: str = ""
    reason: str | None = None
    facts: Mapping[str, Any] | None = None


def heard_of(name: str, facts: Mapping[str, Any]) -> Happened:
    """What a run's process tells: its progress, or a warning."""
    if "warning" in facts:
        return Happened("told", name, f"{name}: warning: {facts['warning']}")
    return Happened("at", name, facts=facts)


@runtime_checkable
class Place(Protocol):
    """Where runs are done: processes of this machine, or the workers of a cluster."""

    def is_free(self) -> bool:
        """Whether one more can begin now."""
        ...

    def begin(self, name: str, order: dict[str, Any]) -> None:
        """Begin the run: ``order`` is plain JSON, what ``cli/one_run.py`` reads."""
        ...

    def events(self, seconds: float) -> list[Happened]:
        """What has happened since the last call; waits up to ``seconds`` for something to happen. Raises BackendError
        where no run can be done there any more."""
        ...

    def stop(self) -> None:
        """Let each run end its step and save; ``ended`` events follow."""
        ...

    def close(self) -> None:
        """End at once what is still there."""
        ...


@dataclass(frozen=True)
class Waiting:
    """A run that begins once the run ``on`` has ended, if that is one of the same lot: ``order`` makes what it is told
    then, or raises RinglightError."""

    on: str
    order: Callable[[], dict[str, Any]]


Order = dict[str, Any] | Waiting
"""What a run is told, plain JSON, as soon as it is known."""


def run_many(
    orders: Mapping[str, Order],
    place: Place,
    hear: Callable[[Happened], None],
    stopping: Callable[[], int],
) -> dict[str, str]:
    """Do all of the runs, by name; returns a sentence for each that failed, or that ``place``, which is gone, left.

    ``stopping`` counts the signals that came: at the first no run begins and all under way save, at the second they end
    at once. What ends so is no failure and is not in the result, but a run that could not save is.
    """
    course = _Course(deque(orders), dict.fromkeys(orders, 0), _awaited(orders))
    asked_to_stop = False
    try:
        while course.under_way or (course.waiting and not stopping()):
            if stopping() and not asked_to_stop:
                asked_to_stop = True
                place.stop()
            if stopping() > 1:
                break
            while not stopping() and place.is_free() and (name := course.next()) is not None:
                order, reason = _made(orders[name], course)
                if order is None:
                    ended = Happened("ended", name, reason)
                    course.taken(ended, is_stopping=False)
                    hear(ended)
                    continue
                place.begin(name, order)
                hear(Happened("began", name))
            for event in place.events(POLL_SECONDS):
                told = course.taken(event, is_stopping=stopping() > 0)
                if told is not None:
                    hear(told)
    except BackendError as error:  # what is finished has its table all the same
        course.failed |= dict.fromkeys([*sorted(course.under_way), *course.waiting], str(error))
        hear(Happened("told", reason=str(error)))
    finally:
        place.close()
    return course.failed


def _awaited(orders: Mapping[str, Order]) -> dict[str, str]:
    return {name: order.on for name, order in orders.items() if isinstance(order, Waiting) and order.on in orders}


def _made(order: Order, course: "_Course") -> tuple[dict[str, Any] | None, str | None]:
    """What the run is told, or why it cannot be."""
    if not isinstance(order, Waiting):
        return order, None
    if order.on in course.failed:
        return None, f"it waited for {order.on}, which failed"
    try:
        return order.order(), None
    except RinglightError as error:
        return None, str(error)


@dataclass
class _Course:
    """Which runs wait, are under way, and have failed, how many workers died with each, and which waits for which."""

    waiting: deque[str]
    losses: dict[str, int]
    awaited: Mapping[str, str]
    under_way: set[str] = field(default_factory=set)
    failed: dict[str, str] = field(default_factory=dict)

    def next(self) -> str | None:
        """The run that begins now: the first that waits for none of the others; None where there is none."""
        coming = {*self.waiting, *self.under_way}
        name = next((name for name in self.waiting if self.awaited.get(name) not in coming), None)
        if name is not None:
            self.waiting.remove(name)
            self.under_way.add(name)
        return name

    def taken(self, event: Happened, is_stopping: bool) -> Happened | None:
        """What is told of it: None of what was stopped, which did not fail; that a run which is given up has ended."""
        if event.kind in ("ended", "lost"):
            self.under_way.discard(event.name)
        if event.kind == "lost":
            self.losses[event.name] += 1
            if self.losses[event.name] < MOST_LOSSES:
                self.waiting.appendleft(event.name)
                return event
            event = Happened("ended", event.name, f"{MOST_LOSSES} workers died with it; the last: {event.reason}")
        if event.kind != "ended" or event.reason is None:
            return event
        if is_stopping and event.reason.startswith(STOPPED):
            return None
        self.failed[event.name] = event.reason
        return event
