"""A run of many in a process of its own: whoever ends it, and however often, it saves."""

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from ringlight.data.options import SceneOptions
from ringlight.files.tensor_file import read_metadata
from ringlight.runs.method_runs import methods_named, order_of, plan
from ringlight.runs.one_process import COMMAND

STEPS = 100_000
"""More than are done before the run is ended."""


@pytest.fixture
def run(tiny: Path, tmp_path: Path) -> Path:
    return tmp_path / tiny.name / "3dgs" / "seed-0"


@pytest.fixture
def training(tiny: Path, tmp_path: Path) -> Iterator["subprocess.Popen[str]"]:
    """The process of a run that has done some steps."""
    planned = plan([tiny], methods_named(["3dgs"], [], STEPS), (0,), tmp_path, SceneOptions(initial_points=100))
    order = order_of(next(iter(planned.values())).run, 1, "auto", ())
    pipe = subprocess.PIPE
    with subprocess.Popen(COMMAND, stdin=pipe, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(order) + "\n")
        process.stdin.flush()
        next(line for line in process.stdout if json.loads(line)["step"] > 0)
        yield process
        process.kill()


def test_a_signal_and_the_end_of_its_input_together_save(training: "subprocess.Popen[str]", run: Path) -> None:
    """As where a service manager signals all processes of a table, and the table then closes its runs' input."""
    training.send_signal(signal.SIGTERM)
    _, said = training.communicate(timeout=60)
    assert training.returncode == 128 + signal.SIGTERM, said
    saved = read_metadata(run / "checkpoint.safetensors")["step"]
    assert f"stopped after step {saved} and saved" in said
