"""A run whose record has a setting of another version: its model and its report are there all the same."""

import json
from pathlib import Path

import pytest
from command import Command
from refusal import QUIET, refused
from scenes_on_disk import edit_json

from ringlight.view.on_disk import OnDisk


@pytest.fixture
def newer(run_folder: Path) -> Path:
    edit_json(run_folder / "recipe.json", lambda record: record["options"].update(colour="grey"))
    return run_folder


def test_what_needs_the_model_alone_goes_on(newer: Path, tmp_path: Path, ringlight: Command) -> None:
    told = json.loads(ringlight("info", newer, "--json").out)
    assert "unknown setting 'colour'" in told["run"]["problems"][0]
    assert told["run"]["psnr"] is not None
    page = tmp_path / "page.html"
    assert ringlight("report", newer, page).code == 0
    assert "unknown setting" in page.read_text(encoding="utf-8")
    assert ringlight("render", newer, "--path", "orbit", "--frames", "1", "--quiet").code == 0
    assert ringlight("compress", newer, tmp_path / "small.safetensors", "--quiet").code == 0
    assert OnDisk(newer, "auto").opened.stored.header.step == 40


def test_what_needs_the_record_refuses_with_its_place(newer: Path, ringlight: Command) -> None:
    refused(ringlight("train", "--resume", newer, *QUIET), 1, newer / "recipe.json", "unknown setting 'colour'")
    refused(ringlight("eval", newer, *QUIET), 1, newer / "recipe.json", "unknown setting 'colour'")
