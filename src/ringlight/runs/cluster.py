"""Runs on the workers of a Dask scheduler, one at a time on each; one whose worker dies goes on elsewhere.

Dask sends the functions of this file by name (its pickle of a function is its module's name and its own) and what they
are given as plain values. Folders are on a disk that all machines share, under the same path.
"""

import asyncio
import json
import logging
import platform
import time
import warnings
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import ringlight
from ringlight.errors import BackendError
from ringlight.runs.many import STOPPED, Happened, heard_of
from ringlight.runs.one_process import do_run

SCHEDULER_SECONDS = 20
"""In which a scheduler must answer."""

WORKER_SECONDS = 120.0
"""In which there must be a worker that can be used, whenever there is none with a run."""

TELL_SECONDS = 1.0
"""Between two events of a run's progress."""

LOOK_SECONDS = 1.0
"""Between two looks at which workers there are."""

SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")
"""Of addresses that Dask can ask."""

TOPIC = "ringlight"
"""Of the events that workers send, in which progress is."""

INSTALL = "install Dask with pip install 'ringlight[cluster]', here and on all workers"


def versions() -> dict[str, str]:
    """What must be alike here and on a worker, where the same bits are wanted; runs there."""
    try:
        torch = version("torch").split("+")[0]
    except PackageNotFoundError:
        torch = "none"
    return {"ringlight": ringlight.__version__, "python": platform.python_version(), "torch": torch}


def run_on_worker(name: str, order: str) -> str | None:
    """Runs on a worker: the run that the JSON ``order`` describes, in a process of its own; see :func:`do_run`.

    It stops where Dask has dropped the task, because the command was stopped or is gone.
    """
    from distributed import get_worker

    worker = get_worker()
    asked, key, told = json.loads(order), worker.get_current_task(), 0.0
    asked["threads"] = asked["threads"] or worker.state.nthreads

    def is_wanted() -> bool:
        task = worker.state.tasks.get(key)
        return task is not None and task.state not in ("cancelled", "released", "forgotten")

    def tell(facts: Mapping[str, Any]) -> None:
        nonlocal told
        if "warning" in facts or time.monotonic() - told >= TELL_SECONDS or facts["step"] == facts["steps"]:
            told = time.monotonic()
            worker.log_event(TOPIC, {"name": name, "facts": dict(facts)})

    return do_run(asked, tell, is_wanted)


class Cluster:
    """A :class:`~ringlight.runs.many.Place`: the workers of the scheduler at ``address`` whose versions are ours.

    Raises BackendError where Dask is not installed, or the scheduler does not answer.
    """

    def __init__(self, address: str, worker_seconds: float = WORKER_SECONDS):
        try:
            from distributed import Client
        except ImportError:
            raise BackendError(f"--scheduler needs Dask's distributed; {INSTALL}") from None
        if address.partition("://")[0] not in SCHEMES:  # Dask would ask for it for a minute, and end in a traceback
            raise BackendError(f"--scheduler {address}: is no scheduler's address; give it as tcp://HOST:PORT")
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        warnings.filterwarnings("ignore", module="distributed")  # of versions; we say ourselves which must agree
        try:
            self._client = Client(address, timeout=SCHEDULER_SECONDS, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise BackendError(
                f"--scheduler {address}: does not answer within {SCHEDULER_SECONDS} seconds "
                f"({type(error).__name__}); start one with 'dask scheduler', and look at address and firewall"
            ) from None
        self._worker_seconds = worker_seconds
        self._judged: dict[str, str | None] = {}
        """By worker: why it is refused, or None."""
        self._futures: dict[str, tuple[str, Any]] = {}
        """By run: its worker and Dask's future."""
        self._happened: list[Happened] = []
        self._looked = 0.0
        self._lacking_since = time.monotonic()
        self._is_stopping = False
        self._client.subscribe_topic(TOPIC, self._hear)

    def is_free(self) -> bool:
        return self._client.status == "running" and bool(self._free())

    def begin(self, name: str, order: dict[str, Any]) -> None:
        worker = self._free()[0]
        future = self._client.submit(
            run_on_worker, name, json.dumps(order),
            workers=[worker], allow_other_workers=False, pure=False, retries=0,
        )  # fmt: skip
        self._futures[name] = (worker, future)

    def events(self, seconds: float) -> list[Happened]:
        time.sleep(seconds)
        if time.monotonic() - self._looked >= LOOK_SECONDS:
            self._look()
        for name, (worker, future) in list(self._futures.items()):
            if future.done():
                del self._futures[name]
                self._happened.append(_ended(name, worker, future))
            elif worker not in self._judged:
                del self._futures[name]
                future.cancel(force=True)
                self._happened.append(Happened("lost", name, f"worker {worker} is gone"))
        happened, self._happened = self._happened, []
        return happened

    def stop(self) -> None:
        # A task that Dask has dropped tells nothing more; what it does until it has saved is over when its lock is.
        self._is_stopping = True
        for name, (_, future) in self._futures.items():
            future.cancel(force=True)
            self._happened.append(Happened("ended", name, STOPPED))
        self._futures.clear()

    def close(self) -> None:
        for _, future in self._futures.values():
            with suppress(Exception):
                future.cancel(force=True)
        with suppress(Exception):  # it may be gone
            self._client.close(timeout=LOOK_SECONDS)

    def _free(self) -> list[str]:
        busy = {worker for worker, _ in self._futures.values()}
        return [worker for worker, refused in self._judged.items() if refused is None and worker not in busy]

    def _hear(self, event: Any) -> None:
        _, message = event
        self._happened.append(heard_of(message["name"], message["facts"]))

    def _look(self) -> None:
        """At the workers that there are: new ones are judged. Raises BackendError where there is none for too long."""
        self._looked = time.monotonic()
        try:
            there = set(self._client.scheduler_info(n_workers=-1)["workers"])
        except (OSError, TypeError, KeyError):
            there = set()
        if self._client.status != "running":
            there = set()
        for gone in self._judged.keys() - there:
            del self._judged[gone]
        new = sorted(there - self._judged.keys())
        try:
            answers = self._client.run(versions, workers=new, on_error="return") if new else {}
        except (OSError, asyncio.TimeoutError):  # they are asked again, if there still are any
            new = []
        for worker in new:
            self._judged[worker] = reason = _refusal(worker, answers.get(worker))
            if reason is not None:
                self._happened.append(Happened("told", reason=f"warning: {reason}"))
        usable = [worker for worker, refused in self._judged.items() if refused is None]
        if usable or self._is_stopping:
            self._lacking_since = time.monotonic()
        elif time.monotonic() - self._lacking_since > self._worker_seconds:
            why = next((reason for reason in self._judged.values() if reason), "it has none")
            raise BackendError(
                f"the scheduler has had no worker that can be used for {self._worker_seconds:.0f} seconds ({why}); "
                "start one with 'dask worker', the same command goes on"
            )


def _refusal(worker: str, answer: Any) -> str | None:
    """Why this worker is not used; None for one with our versions."""
    if not isinstance(answer, dict):
        return f"worker {worker} is not used: it cannot load ringlight ({type(answer).__name__}); {INSTALL}"
    ours = versions()
    other = [f"{name} {answer.get(name)} where this command has {mine}" for name, mine in ours.items()
             if answer.get(name) != mine]  # fmt: skip
    return f"worker {worker} is not used: it has {' and '.join(other)}; install the same there" if other else None


def _ended(name: str, worker: str, future: Any) -> Happened:
    if future.status == "finished":
        return Happened("ended", name, future.result())
    if future.status in ("lost", "cancelled"):
        return Happened("lost", name, f"worker {worker} is gone")
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Happened("lost", name, f"worker {worker} died")
    return Happened("ended", name, f"worker {worker} failed ({type(error).__name__}: {' '.join(str(error).split())})")
