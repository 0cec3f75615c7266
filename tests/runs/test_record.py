"""recipe.json is JSON that anybody reads, and those of earlier versions are read."""

import json
import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RunError
from ringlight.methods.table import METHODS
from ringlight.runs.record import RECORD_NAME, RunRecord


@pytest.fixture
def record(tmp_path: Path) -> RunRecord:
    return RunRecord("3dgs", METHODS["3dgs"], tmp_path, SceneOptions(), 0, "cpu", "1")


def test_what_json_has_not_is_refused(record: RunRecord, tmp_path: Path) -> None:
    options = SceneOptions()
    object.__setattr__(options, "photo_memory", math.inf)  # as if it did not refuse that itself
    with pytest.raises(RecipeError, match=r"recipe.json: .* is infinite or no number; give a finite one"):
        replace(record, options=options).write(tmp_path)
    assert not any(tmp_path.iterdir())


def test_infinity_of_an_earlier_version_is_the_largest_number(record: RunRecord, tmp_path: Path) -> None:
    values = json.loads(record.to_json())
    values["recipe"]["densify"]["threshold"] = math.inf
    (tmp_path / RECORD_NAME).write_text(json.dumps(values))
    read = RunRecord.read(tmp_path)
    assert read.recipe.densify.threshold == sys.float_info.max
    read.write(tmp_path)
    assert RunRecord.read(tmp_path) == read


@pytest.mark.parametrize(
    "change",
    [
        lambda values: values["recipe"].update(colour="grey"),
        lambda values: values["recipe"].update(steps="many"),
        lambda values: values["options"].update(downscale=0),
        lambda values: values["options"].pop("downscale"),
    ],
)
def test_a_setting_that_this_version_does_not_know_is_the_folders_fault(
    change: Callable[[dict[str, Any]], object], record: RunRecord, tmp_path: Path
) -> None:
    values = json.loads(record.to_json())
    change(values)
    (tmp_path / RECORD_NAME).write_text(json.dumps(values))
    with pytest.raises(RunError, match=re.escape(str(tmp_path / RECORD_NAME))):
        RunRecord.read(tmp_path)
