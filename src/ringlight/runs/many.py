"""Many runs, wherever they are done: as many at a time as there are places, and none that fails stops another."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

POLL_SECONDS = 0.25
"""Between two looks at what has happened, and at the keyboard."""

MOST_LOSSES = 3
"""Workers that may die with one run before it is given up: it may be the run that kills them."""


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
        """What has happened since the last call; waits up to ``seconds`` for something to happen."""
        ...

    def stop(self) -> None:
        """Let each run end its step and save; ``ended`` events follow."""
        ...

    def close(self) -> None:
        """End at once what is still there."""
        ...


def run_many(
    orders: Mapping[str, dict[str, Any]],
    place: Place,
    hear: Callable[[Happened], None],
    stopping: Callable[[], int],
) -> dict[str, str]:
    """Do all of the runs, by name; returns a sentence for each that failed.

    ``stopping`` counts the signals that came: at the first no run begins and all under way save, at the second they end
    at once. What ends so is no failure and is not in the result.
    """
    waiting, under_way, losses = deque(orders), set[str](), dict.fromkeys(orders, 0)
    failed: dict[str, str] = {}
    asked_to_stop = False
    try:
        while under_way or (waiting and not stopping()):
            if stopping() and not asked_to_stop:
                asked_to_stop = True
                place.stop()
            if stopping() > 1:
                break
            while waiting and not stopping() and place.is_free():
                name = waiting.popleft()
                under_way.add(name)
                place.begin(name, orders[name])
                hear(Happened("began", name))
            for event in place.events(POLL_SECONDS):
                if event.kind in ("ended", "lost"):
                    under_way.discard(event.name)
                if event.kind == "ended" and event.reason is not None and not stopping():
                    failed[event.name] = event.reason
                if event.kind == "lost":
                    losses[event.name] += 1
                    if losses[event.name] < MOST_LOSSES:
                        waiting.appendleft(event.name)
                    else:
                        failed[event.name] = f"{MOST_LOSSES} workers died with it; the last: {event.reason}"
                hear(event)
    finally:
        place.close()
    return failed
