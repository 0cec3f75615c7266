"""Where ringlight lights pixels, its files say what was trained; those that said otherwise are read all the same."""

import json
from pathlib import Path

import pytest
import torch
from command import Command

from ringlight.files.tensor_file import read_tensors

STEPS = 40


@pytest.fixture
def deferred(tiny: Path, tmp_path: Path, ringlight: Command) -> Path:
    run = tmp_path / "deferred"
    words = ("--steps", STEPS, "--shading", "mirror", "--initial-points", "300", "--quiet", "--lpips")
    words += ("--save-every", "0.001")
    assert ringlight("train", tiny, "ringlight", *words, "--out", run).code == 0
    return run


def test_its_files_record_the_settings_that_count(deferred: Path, ringlight: Command) -> None:
    shown = ringlight("info", deferred).out
    assert "ringlight (ringlight-mirror)" in shown
    assert "shader: " in shown
    assert "levels=[8, 16, 32, 64]" in shown
    assert "field_rate" not in shown
    record = json.loads((deferred / "recipe.json").read_text())
    assert (record["preset"], record["method"]) == ("ringlight", "ringlight-mirror")
    assert (record["recipe"]["steps"], record["recipe"]["shader"]["levels"]) == (STEPS, [8, 16, 32, 64])
    report = json.loads((deferred / "report.json").read_text())
    assert (report["preset"], report["method"]) == ("ringlight", "ringlight-mirror")


def test_it_goes_on_with_the_same_bits(deferred: Path, ringlight: Command) -> None:
    run = deferred
    whole = read_tensors(run / "model.safetensors").tensors
    (run / "checkpoint.safetensors").unlink()  # the other one is of a step before
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
    again = read_tensors(run / "model.safetensors").tensors
    assert whole.keys() == again.keys()
    assert all(torch.equal(tensor, again[name]) for name, tensor in whole.items())


def test_every_command_takes_it(deferred: Path, tmp_path: Path, ringlight: Command) -> None:
    run = deferred
    for words in (
        ("info", run),
        ("eval", run, "--lpips"),
        ("render", run, "--path", "orbit", "--frames", "1"),
        ("compress", run, tmp_path / "small.safetensors"),
        ("eval", tmp_path / "small.safetensors", "--lpips"),
        ("compare", run),
        ("train", "--resume", run, "--quiet"),
    ):
        done = ringlight(*words)
        assert done.code == 0, done.err
