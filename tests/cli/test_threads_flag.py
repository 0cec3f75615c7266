"""More threads than cores are told of once, where they are asked for, and no other number is."""

import pytest

from ringlight.cli import threads
from ringlight.cli.threads import check_threads


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "usable_cores", lambda: 2)


@pytest.mark.parametrize(
    ("count", "jobs", "asked"), [(3, 1, "3 and this process"), (2, 2, "2 for each of 2 runs side by side, and this")]
)
def test_more_threads_than_cores_are_told_of(
    count: int, jobs: int, asked: str, capsys: pytest.CaptureFixture[str]
) -> None:
    check_threads(count, jobs)
    said = capsys.readouterr().err
    assert said.startswith(f"warning: --threads is {asked}")
    assert "2 cores" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(("count", "jobs"), [(0, 1), (1, 1), (2, 1), (0, 8), (1, 2), (64, 0)])
def test_as_many_as_there_are_cores_are_not(count: int, jobs: int, capsys: pytest.CaptureFixture[str]) -> None:
    check_threads(count, jobs)
    assert capsys.readouterr().err == ""
