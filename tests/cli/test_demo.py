"""``ringlight demo``: ends with a table, pictures, advice and a page; overwrites nothing; goes on where it stopped."""

import json

import pytest
from parsed import Parsed, assert_loads_nothing

from ringlight.cli import progress
from ringlight.cli.main import run
from ringlight.runs.demo import METHODS_SHOWN


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "made" / "here"
    assert run(["demo", "carpaint", "--steps", "4", "--out", str(folder), "--quiet"]) == 0
    return folder


def test_folder_holds_both_runs_and_the_sheet(finished):
    assert {path.name for path in finished.iterdir()} == {
        "demo.json",
        "contact_sheet.png",
        "report.html",
        "share.html",
        *METHODS_SHOWN,
    }
    for method in METHODS_SHOWN:
        report = json.loads((finished / method / "report.json").read_text())
        assert (report["preset"], report["scene"], report["iterations"]) == (method, "carpaint", 4)


def test_nothing_is_trained_again_when_all_is_there(finished, capsys):
    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*.safetensors")}
    assert run(["demo", "--resume", str(finished)]) == 0
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*.safetensors")} == before
    shown = capsys.readouterr()
    assert all(method in shown.out for method in METHODS_SHOWN)
    assert "contact_sheet.png" in shown.out
    assert "ringlight train my-photos ringlight" in shown.err
    of_runs, of_model = shown.out.splitlines()[-2:]
    assert of_runs == f"open in a browser: {finished / 'report.html'}, both runs beside each other"
    assert of_model == f"open in a browser: {finished / 'share.html'}, the model of ringlight itself"


def test_it_ends_with_a_page_about_both_runs(finished):
    page = Parsed((finished / "report.html").read_text(encoding="utf-8"))
    assert_loads_nothing(page)
    labels = {group["data-label"] for group in page.all("g") if "data-label" in group}
    assert labels == set(METHODS_SHOWN)


def test_it_ends_with_a_page_that_shows_the_model(finished):
    page = Parsed((finished / "share.html").read_text(encoding="utf-8"))
    assert {script.get("id") for script in page.all("script")} == {None, "facts", "payload"}


def test_a_folder_that_holds_something_is_left_alone(finished, capsys):
    assert run(["demo", "--out", str(finished)]) == 1
    assert "not an empty folder" in capsys.readouterr().err


def test_stopping_and_going_on_gives_the_same_numbers(finished, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "demo"
    show_steps = progress.show_steps
    monkeypatch.setattr(progress, "show_steps", lambda session, options, flags: show_steps(session, options, [True]))
    words = ["carpaint", "--steps", "4", "--out", str(folder), "--quiet"]
    assert run(["demo", *words]) == 130
    assert f"ringlight demo --resume {folder}" in capsys.readouterr().err
    assert run(["eval", str(folder / METHODS_SHOWN[0]), "--quiet", "--lpips"]) == 0, "measured before it has ended"
    monkeypatch.setattr(progress, "show_steps", show_steps)
    assert run(["demo", "--resume", str(folder), "--quiet"]) == 0
    for method in METHODS_SHOWN:
        ours, theirs = (json.loads((f / method / "report.json").read_text()) for f in (folder, finished))
        assert ours["psnr"] == theirs["psnr"]


def test_default_folder_is_numbered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "demo-toaster").mkdir(parents=True)
    assert run(["demo", "--steps", "1", "--quiet"]) == 0
    assert (tmp_path / "runs" / "demo-toaster-2" / "contact_sheet.png").is_file()
    assert not any((tmp_path / "runs" / "demo-toaster").iterdir())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["toster"], "perhaps you meant 'toaster'"),
        (["--steps", "0"], "--steps is 0"),
        (["--resume", "nowhere"], "nowhere: holds no demo.json"),
        (["--resume", "nowhere", "--steps", "10"], "goes on with the demo as it was begun; leave --steps out"),
        (["carpaint", "--resume", "nowhere"], "leave SCENE out"),
    ],
)
def test_mistakes_are_one_sentence(words, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["demo", *words]) == 1
    assert sentence in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text", ['{"scene": "toaster"', '{"scene": "toaster", "steps": Infinity, "seed": 0}', "[" * 10**5]
)
def test_a_damaged_plan_is_said(text: str, tmp_path, capsys):
    (tmp_path / "demo.json").write_text(text)
    assert run(["demo", "--resume", str(tmp_path)]) == 1
    assert "cannot be understood" in capsys.readouterr().err
