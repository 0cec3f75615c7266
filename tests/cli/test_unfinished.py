"""Whoever takes the model of a run that has steps to go is told so, and how it goes on."""

import shutil
from pathlib import Path

import pytest
from command import Command

from ringlight.runs.record import RunRecord

OUT = {"export": "a.ply", "compress": "a.safetensors", "share": "a.html", "edit": "a.safetensors", "render": ""}
FLAGS = {"export": ("--fit-steps", 0), "edit": ("--residual", 0.5), "render": ("--frames", 1)}


@pytest.fixture
def unfinished(trained: dict[str, Path], tmp_path: Path) -> Path:
    """A run whose record has five steps more than it did, as one that was stopped."""
    folder = Path(shutil.copytree(trained["ringlight-basis"], tmp_path / "run"))
    RunRecord.read(folder).extended(5).write(folder)
    return folder


@pytest.mark.parametrize("verb", OUT)
def test_it_is_said_of_a_run_alone(verb: str, unfinished: Path, tmp_path: Path, ringlight: Command) -> None:
    words = (*((tmp_path / OUT[verb],) if OUT[verb] else ()), *FLAGS.get(verb, ()))
    done = ringlight(verb, unfinished, *words)
    planned = RunRecord.read(unfinished).steps
    assert done.code == 0, done.err
    assert f"{unfinished}: is at step {planned - 5} of {planned}; " in done.err
    assert f"ringlight train --resume {unfinished}\n" in done.err
    overwritten = (*words, "--overwrite") if OUT[verb] else (*words, "--out", tmp_path / "frames")
    of_file = ringlight(verb, unfinished / "model.safetensors", *overwritten)
    assert of_file.code == 0, of_file.err
    assert "--resume" not in of_file.err


def test_a_page_on_one_that_was_measured_all_the_same_says_it(
    unfinished: Path, tmp_path: Path, ringlight: Command
) -> None:
    done = ringlight("report", unfinished, tmp_path / "page.html")
    planned = RunRecord.read(unfinished).steps
    assert f"was measured at step {planned - 5} of {planned}; go on with: ringlight train --resume" in done.err
