"""Runs on a Dask cluster of processes: a worker that dies costs its run's time since the checkpoint, and no more."""

import logging
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ringlight.data.options import SceneOptions
from ringlight.errors import BackendError
from ringlight.runs import cluster
from ringlight.runs.many import Happened, run_many
from ringlight.runs.method_runs import methods_named, order_of, plan

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def workers() -> Iterator[Any]:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    made = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    )
    yield made
    made.close(timeout=10)


def orders(out: Path, steps: int, seeds: tuple[int, ...]) -> dict[str, dict[str, Any]]:
    runs = plan([Path("toaster")], methods_named(["3dgs"], [], steps), seeds, out, SceneOptions(initial_points=500))
    return {f"seed-{key[2]}": order_of(surveyed.run, 0, "auto", ()) for key, surveyed in runs.items()}


def test_a_worker_that_dies_costs_its_run_and_nothing_else(workers: Any, tmp_path: Path) -> None:
    asked = orders(tmp_path, 300, (0, 1, 2))
    heard: list[Happened] = []
    killed: list[str] = []

    def hear(event: Happened) -> None:
        heard.append(event)
        if event.kind == "at" and event.facts is not None and event.facts["step"] > 0 and not killed:
            place_of_run = place._futures[event.name][0]
            worker = next(w for w in workers.workers.values() if w.worker_address == place_of_run)
            os.kill(worker.pid, signal.SIGKILL)
            killed.append(event.name)

    place = cluster.Cluster(workers.scheduler_address)
    failed = run_many(asked, place, hear, lambda: 0)
    assert failed == {}
    assert killed
    assert [event.name for event in heard if event.kind == "lost"] == killed
    for seed in (0, 1, 2):
        assert (tmp_path / "toaster" / "3dgs" / f"seed-{seed}" / "report.json").exists()


def test_stopping_ends_runs_on_workers_and_saves_them(workers: Any, tmp_path: Path) -> None:
    asked = orders(tmp_path, 20_000, (0,))
    at: list[int] = []

    def hear(event: Happened) -> None:
        if event.kind == "at" and event.facts is not None and event.facts["step"] > 0:
            at.append(event.facts["step"])

    failed = run_many(asked, cluster.Cluster(workers.scheduler_address), hear, lambda: int(bool(at)))
    assert failed == {}
    run = tmp_path / "toaster" / "3dgs" / "seed-0"
    from ringlight.runs.lock import RunLock
    from ringlight.runs.resume import resume_run

    last = time.monotonic() + 60
    while True:
        try:
            RunLock(run).release()
            break
        except Exception:
            assert time.monotonic() < last, "the run goes on without its command"
            time.sleep(0.2)
    assert resume_run(run).training.step >= at[0]


def test_workers_of_other_versions_are_refused_and_said(
    workers: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster.ringlight, "__version__", "9.9")
    heard: list[Happened] = []
    place = cluster.Cluster(workers.scheduler_address, worker_seconds=3.0)
    failed = run_many(orders(tmp_path, 10, (0,)), place, heard.append, lambda: 0)
    assert "no worker that can be used" in failed["seed-0"]
    *told, last = [event.reason or "" for event in heard if event.kind == "told"]
    assert last == failed["seed-0"]
    assert told
    assert all("ringlight 0.1.0 where this command has 9.9" in reason for reason in told)


def test_a_scheduler_that_does_not_answer_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "SCHEDULER_SECONDS", 1)
    with pytest.raises(BackendError, match="does not answer within 1 seconds"):
        cluster.Cluster("tcp://127.0.0.1:9")
