"""The benchmarks of volumes that pages quote run to their end."""

import importlib
from pathlib import Path

import pytest

from ringlight.volume import model

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.usefixtures("all_cores_afterwards")
@pytest.mark.parametrize(("name", "small"), [("putt_step", {"LAST_LEVELS": 5}), ("volume_step", {"SIDES": {"vm": 24}})])
def test_a_benchmark_says_how_long_its_steps_take(
    name: str, small: dict[str, object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setattr("sys.argv", [name])
    workload, benchmark = importlib.import_module("volume_workload"), importlib.import_module(name)
    monkeypatch.setattr(workload, "RAYS", 64)
    monkeypatch.setattr(model, "runs_native", model.runs_native)  # which one of them sets
    for constant, value in small.items():
        monkeypatch.setattr(benchmark, constant, value)
    benchmark.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all("ms" in line and "MB at most so far" in line for line in lines)
