"""One process at a time trains a run, and how that process ends does not matter."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ringlight.errors import RunError
from ringlight.runs import lock
from ringlight.runs.lock import RunLock

pytestmark = pytest.mark.skipif(lock.fcntl is None, reason="needs locks on files")

HOLD = "import sys, time; from pathlib import Path; from ringlight.runs.lock import RunLock; "
HOLD += "held = RunLock(Path(sys.argv[1])); print('held', flush=True); time.sleep(600)"


@pytest.fixture
def other(tmp_path: Path):
    """A process that trains the run, as far as anybody can see."""
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_a_second_process_is_refused_by_the_name_of_the_first(other: subprocess.Popen, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="is training or measuring this run; wait") as caught:
        RunLock(tmp_path)
    if sys.platform == "linux":
        assert f"process {other.pid} " in str(caught.value)
    assert list(tmp_path.iterdir()) == [], "a lock is no file"


def test_a_killed_process_holds_nothing(other: subprocess.Popen, tmp_path: Path) -> None:
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    RunLock(tmp_path)


def test_it_can_be_released(tmp_path: Path) -> None:
    first = RunLock(tmp_path)
    with pytest.raises(RunError):
        RunLock(tmp_path)
    first.release()
    first.release()
    RunLock(tmp_path)


def test_where_the_system_does_not_say_who_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "LOCKS", tmp_path / "none")
    held = RunLock(tmp_path)
    with pytest.raises(RunError, match="another process is training or measuring"):
        RunLock(tmp_path)
    held.release()


def test_a_disk_without_locks_locks_nobody_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(lock.fcntl, "flock", cannot)
    RunLock(tmp_path)
    RunLock(tmp_path)
