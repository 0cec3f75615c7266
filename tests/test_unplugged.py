"""Ten of the two hundred kills of ``make unplug``."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_runs_that_are_killed_and_resumed_leave_the_same_files():
    command = [sys.executable, str(Path(__file__).with_name("unplugging.py")), "--kills", "10", "--seed", "1"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    assert " kills in " in done.stdout
