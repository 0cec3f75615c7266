"""What a table is asked that is not there: left out by name, and told apart from what is there."""

from pathlib import Path

import pytest

from ringlight.errors import RecipeError, RinglightError
from ringlight.runs.left_out import asked_for

SEEDS = (0, 1)


def test_columns_rows_and_their_settings_are_left_out(tmp_path: Path):
    settings = ("a.steps=3", "3dgs.steps=4")
    found = asked_for([Path("toaster"), tmp_path / "none"], ["a=nope", "3dgs"], settings)
    assert (found.scenes, found.methods, found.settings) == ((Path("toaster"),), ("3dgs",), ("3dgs.steps=4",))
    reasons = found.reasons(SEEDS)
    none = str(tmp_path / "none")
    assert reasons.keys() == {(row, column, seed) for seed in SEEDS for row, column in (
        ("toaster", "a"), (none, "a"), (none, "3dgs"))}  # fmt: skip
    assert "no method is called 'nope'" in reasons["toaster", "a", 0]
    assert "no such folder" in reasons[none, "a", 1]


def test_a_row_that_is_missing_is_not_taken_for_another_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data" / "lego").mkdir(parents=True)
    found = asked_for([Path("lego"), Path("data/lego")], ["3dgs"], ())
    assert found.reasons((0,)).keys() == {(str(tmp_path / "lego"), "3dgs", 0)}


@pytest.mark.parametrize("scenes", [["toaster"], ["toaster", "carpaint"]])
def test_where_nothing_remains_the_first_error_is_raised(scenes: list[str]):
    with pytest.raises(RecipeError, match="no method is called 'a'"):
        asked_for(list(map(Path, scenes)), ["a", "b"], ())
    with pytest.raises(RinglightError, match="toastre"):
        asked_for([Path("toastre"), Path("nowhere")], ["3dgs"], ())


def test_columns_of_one_name_are_refused_though_one_is_unknown():
    with pytest.raises(RecipeError, match="'a' twice"):
        asked_for([Path("toaster")], ["a=3dgs", "a=nope"], ("a.steps=3",))
