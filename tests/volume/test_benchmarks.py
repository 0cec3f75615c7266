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
    *lines, peak = lines_of(name, small, monkeypatch, capsys)
    assert len(lines) == 2
    assert "GFLOP/s" in peak
    assert all("ms" in line and "MB at most so far" in line for line in lines)


@pytest.mark.usefixtures("all_cores_afterwards")
def test_a_benchmark_says_what_a_sample_takes(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    lines = lines_of("volume_memory", {"SIDE": 16, "FEW_RAYS": 64}, monkeypatch, capsys)
    assert [line.split(":")[0] for line in lines][-2:] == ["tensorf of three lines", "putt"]
    assert all("bytes a sample" in line for line in lines)


def lines_of(
    name: str, small: dict[str, object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> list[str]:
    """What it prints with these constants."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setattr("sys.argv", [name])
    workload, benchmark = importlib.import_module("volume_workload"), importlib.import_module(name)
    monkeypatch.setattr(workload, "RAYS", 64)
    for constant in ("runs_native", "SHIFT"):  # some of them set these
        monkeypatch.setattr(model, constant, getattr(model, constant))
    for constant, value in small.items():
        monkeypatch.setattr(benchmark, constant, value)
    benchmark.main()
    return capsys.readouterr().out.splitlines()
