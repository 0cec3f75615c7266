"""More threads than cores are told of, and no other number is."""

import pytest

from ringlight import _kernels
from ringlight.cli.threads import use_threads
from ringlight.measure.machine import usable_cores


@pytest.fixture(autouse=True)
def as_before():
    threads = _kernels.threads()
    yield
    _kernels.set_threads(threads)


def test_more_threads_than_cores_are_told_of(capsys: pytest.CaptureFixture[str]) -> None:
    use_threads(usable_cores() + 1)
    assert f"--threads is {usable_cores() + 1} and this process has {usable_cores()} core" in capsys.readouterr().err


@pytest.mark.parametrize("count", [0, 1, usable_cores()])
def test_as_many_as_there_are_cores_are_not(count: int, capsys: pytest.CaptureFixture[str]) -> None:
    use_threads(count)
    assert capsys.readouterr().err == ""
