"""A run whose own model file is replaced: said, with the command that measures the new one; no other file is."""

import shlex
import shutil
from pathlib import Path

import pytest
from command import Command


@pytest.mark.parametrize("words", [("edit", "--base-only"), ("compress",)], ids=["edit", "compress"])
def test_replacing_a_runs_own_model_says_that_its_report_is_of_the_old_one(
    words: tuple[str, ...], run_folder: Path, ringlight: Command
) -> None:
    own = run_folder / "model.safetensors"
    done = ringlight(words[0], run_folder, own, "--overwrite", "--quiet", *words[1:])
    assert done.code == 0, done.err
    assert str(run_folder / "report.json") in done.err
    way = shlex.split(done.err.strip().rpartition("measure this one with: ")[2])
    assert ringlight(*way[1:], "--lpips", "--quiet").code == 0, "the remedy works"


def test_other_files_and_runs_without_a_report_are_not_told_of(
    run_folder: Path, tmp_path: Path, ringlight: Command
) -> None:
    alone = tmp_path / "alone" / "model.safetensors"
    alone.parent.mkdir()
    shutil.copy(run_folder / "model.safetensors", alone)
    for out in (alone, run_folder / "other.safetensors"):
        assert not ringlight("edit", run_folder, out, "--base-only", "--quiet", "--overwrite").err
    (run_folder / "report.json").unlink()
    own = run_folder / "model.safetensors"
    assert not ringlight("edit", run_folder, own, "--base-only", "--quiet", "--overwrite").err
