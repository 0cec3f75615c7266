"""Results are kept under plain names, complete and valid, in place of earlier ones."""

import json

import pytest

from ringlight.bench.record import save_result
from ringlight.errors import OutputError, RecipeError


def test_saved_results_are_valid_and_replace_earlier_ones(tmp_path, monkeypatch, circumstances):
    monkeypatch.chdir(tmp_path)
    path = save_result(circumstances, "raster-avx2")
    assert path.parent.as_posix() == "benchmarks/results"
    assert json.loads(path.read_text())["date"] == "2000-01-01"
    assert save_result(circumstances, "raster-avx2.json") == path
    assert [file.name for file in path.parent.iterdir()] == ["raster-avx2.json"]


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a\\b"])
def test_names_that_lead_elsewhere_are_refused(name, circumstances):
    with pytest.raises(RecipeError):
        save_result(circumstances, name)


def test_a_folder_that_cannot_be_made_is_said(tmp_path, monkeypatch, circumstances):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "benchmarks").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be made"):
        save_result(circumstances, "raster")


def test_others_on_the_machine_are_noticed(circumstances):
    from dataclasses import replace

    assert not circumstances.is_busy
    assert replace(circumstances, load=circumstances.machine.cores + 5.0).is_busy
