"""What ``make sanitize`` and ``make valgrind`` repeat: calls of every function and class of the compiled module."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "recorded_calls.py"


@pytest.mark.slow
def test_every_kernel_is_called_while_the_methods_train(tmp_path: Path):
    command = [sys.executable, str(SCRIPT), "record", str(tmp_path / "calls.npz")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, "never called: none" in done.stdout) == (0, True), done.stdout + done.stderr
