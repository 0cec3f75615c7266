"""The curve of a run is that of its report, or of a checkpoint that is farther."""

import json
from pathlib import Path

import pytest
import torch
from samples import sample_report

from ringlight.files.tensor_file import write_tensors
from ringlight.measure.json_record import to_json
from ringlight.measure.report import CurvePoint
from ringlight.runs.curves import curve_of
from ringlight.runs.folder import RunFolder
from ringlight.runs.history import History


def points(*steps: int) -> tuple[CurvePoint, ...]:
    return tuple(CurvePoint(step, step / 10, 20.0 + step, 5 * step, 1 / step) for step in steps)


def write_report(run: Path, *steps: int) -> None:
    (run / "report.json").write_text(to_json(sample_report(curve=points(*steps))))


def write_checkpoint(run: Path, *steps: int) -> None:
    history = History(100)
    history.points = list(points(*steps))
    write_tensors(run / "checkpoint.safetensors", {"a": torch.zeros(1)}, {"history": history.to_text()})


@pytest.mark.parametrize(
    ("reported", "kept", "wanted"),
    [((10, 20), (10,), (10, 20)), ((10, 20), (10, 20, 30), (10, 20, 30)), ((), (10,), (10,)), ((10,), (), (10,))],
)
def test_the_farther_one_counts(tmp_path: Path, reported, kept, wanted):
    if reported:
        write_report(tmp_path, *reported)
    if kept:
        write_checkpoint(tmp_path, *kept)
    assert tuple(curve_of(RunFolder(tmp_path))) == points(*wanted)


def test_damage_leaves_the_other_one(tmp_path: Path):
    assert curve_of(RunFolder(tmp_path)) == ()
    write_checkpoint(tmp_path, 10)
    (tmp_path / "report.json").write_text("{")
    assert tuple(curve_of(RunFolder(tmp_path))) == points(10)
    write_report(tmp_path, 20)
    (tmp_path / "checkpoint.safetensors").write_bytes(b"damaged")
    assert tuple(curve_of(RunFolder(tmp_path))) == points(20)
    (tmp_path / "report.json").write_text(json.dumps([]))
    assert curve_of(RunFolder(tmp_path)) == ()
