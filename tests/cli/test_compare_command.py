"""``ringlight compare``: one table, a sheet where it is asked for, JSON and markdown for others to read."""

import json
import re

import pytest
from PIL import Image

from ringlight.cli.main import run


@pytest.fixture
def runs(trained):
    """Two short runs of one scene."""
    return [str(trained["3dgs"]), str(trained["ringlight-ring"])]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("width", [80, 120])
def test_table_fits_and_names_every_run(runs, width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    assert run(["compare", *runs]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    assert all(any(line.startswith(name) for line in lines) for name in ("3dgs", "ringlight-ring"))


def test_a_sheet_is_written_only_where_it_is_asked_for(runs, here, capsys):
    assert run(["compare", *runs]) == 0
    assert "--sheet FILE.png" in capsys.readouterr().err
    assert not list(here.iterdir())
    assert run(["compare", *runs, "--sheet", "three.png"]) == 0
    assert run(["compare", *runs, "--sheet", "one.png", "--views", "1"]) == 0
    with Image.open("three.png") as three, Image.open("one.png") as one:
        assert three.width == one.width
        assert three.height > one.height


def test_a_named_sheet_is_replaced_only_when_asked(runs, here, capsys):
    sheet = here / "mine.png"
    sheet.write_text("precious")
    assert run(["compare", *runs, "--sheet", str(sheet)]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert sheet.read_text() == "precious"
    assert run(["compare", *runs, "--sheet", str(sheet), "--overwrite"]) == 0
    Image.open(sheet).verify()


def test_json_holds_whole_reports(runs, capsys):
    assert run(["compare", *runs, "--json", "--baseline", runs[1], "--sheet", "a.png"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["baseline"] == "ringlight-ring"
    assert [each["label"] for each in record["runs"]] == ["ringlight-ring", "3dgs"]
    assert all(each["report"]["images"] for each in record["runs"])
    assert record["sheet"].endswith(".png")
    assert record["differing_settings"] == []


def test_markdown_has_every_run(runs, capsys):
    assert run(["compare", *runs, "--markdown"]) == 0
    table = capsys.readouterr().out
    assert len(re.findall(r"(?m)^\| (3dgs|ringlight-ring) ", table)) == 2


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ([], 2, "no runs are named"),
        (["nowhere"], 1, "no such run folder"),
        (["nowhere", "--views", "0"], 1, "--views is 0"),
        (["nowhere", "--views", "3"], 1, "give --sheet FILE.png with it"),
        (["nowhere", "--json", "--markdown"], 2, "cannot both"),
    ],
)
def test_mistakes_are_one_sentence(words, code, sentence, capsys):
    assert run(["compare", *words]) == code
    complaint = capsys.readouterr().err.strip()
    assert sentence in complaint
    assert len(complaint.splitlines()) == 1


def test_a_sheet_is_a_png(runs, capsys):
    assert run(["compare", *runs, "--sheet", "sheet.pdf"]) == 1
    assert "ends in .png" in capsys.readouterr().err
