"""What is seen of many runs: counted as they end, and drawn by rich's thread while they move on."""

import io
from threading import Thread
from typing import Any

import pytest
from rich.console import Console

from ringlight.cli.console import Screen
from ringlight.cli.many_progress import ManyRuns
from ringlight.runs.many import Happened

FACTS = {"step": 3, "steps": 9, "psnr": 20.0, "count": 1000}


@pytest.fixture
def runs() -> ManyRuns:
    return ManyRuns(["a", "b", "c"], True, Screen(stderr=True))


def drawn(runs: ManyRuns) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(runs)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_runs_are_counted_as_they_end(runs: ManyRuns) -> None:
    for event in (Happened("began", "a"), Happened("began", "b"), Happened("at", "b", facts=FACTS)):
        runs.hear(event)
    assert "0 of 3 runs done, 2 under way, 1 to come" in drawn(runs)
    runs.hear(Happened("lost", "a", "worker w is gone"))
    assert "0 of 3 runs done, 1 under way, 2 to come" in drawn(runs)
    runs.hear(Happened("ended", "a", "3 workers died with it"))
    runs.hear(Happened("ended", "b"))
    assert "1 of 3 runs done, 0 under way, 1 to come, 1 failed" in drawn(runs)


def test_a_picture_is_drawn_while_something_is_heard(runs: ManyRuns) -> None:
    pictures: list[str] = []

    class Facts(dict[str, Any]):
        """Has a picture drawn while they are taken in, and gives it time."""

        def __getitem__(self, key: str) -> Any:
            if not threads:
                threads.append(Thread(target=lambda: pictures.append(drawn(runs))))
                threads[0].start()
                threads[0].join(0.2)
            return super().__getitem__(key)

    threads: list[Thread] = []
    runs.hear(Happened("began", "a"))
    runs.hear(Happened("at", "a", facts=Facts(FACTS)))
    threads[0].join(10)
    assert "1 under way" in pictures[0]
    assert "1,000" in drawn(runs)
