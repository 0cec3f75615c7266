"""Runs side by side on this machine, each a process of its own."""

import queue
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from threading import Event, Thread
from typing import Any

from ringlight.runs.many import Happened, heard_of
from ringlight.runs.one_process import do_run


class SideBySide:
    """A :class:`~ringlight.runs.many.Place` of at most ``jobs`` processes."""

    def __init__(self, jobs: int):
        self.jobs = jobs
        self._under_way = 0
        self._unwanted = Event()
        self._happened: queue.Queue[Happened] = queue.Queue()
        self._processes: list[subprocess.Popen[str]] = []

    def is_free(self) -> bool:
        return self._under_way < self.jobs

    def begin(self, name: str, order: dict[str, Any]) -> None:
        self._under_way += 1
        Thread(target=self._do, args=(name, order), daemon=True).start()

    def events(self, seconds: float) -> list[Happened]:
        events = []
        with suppress(queue.Empty):
            events.append(self._happened.get(timeout=seconds))
            while True:
                events.append(self._happened.get_nowait())
        self._under_way -= sum(event.kind == "ended" for event in events)
        return events

    def stop(self) -> None:
        self._unwanted.set()

    def close(self) -> None:
        self._unwanted.set()
        for process in self._processes:
            if process.poll() is None:
                process.kill()

    def _do(self, name: str, order: dict[str, Any]) -> None:
        def tell(facts: Mapping[str, Any]) -> None:
            self._happened.put(heard_of(name, facts))

        try:
            reason = do_run(order, tell, lambda: not self._unwanted.is_set(), self._processes.append)
        except OSError as error:
            reason = f"its process cannot be started ({error.strerror})"
        self._happened.put(Happened("ended", name, reason))
