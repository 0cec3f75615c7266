"""``ringlight bench``: valid, complete JSON; tables that fit 80 columns; mistakes are one sentence."""

import json

import pytest

from ringlight.cli.main import run

QUICK = ["--rounds", "1", "--seconds", "0"]
SMALL = {
    "raster": ["--sizes", "200@16", "300@24"],
    "parts": ["--sizes", "50@24"],
    "step": ["3dgs", "ringlight-mirror", "--size", "300@24"],
    "fps": ["--sizes", "300@24"],
}


@pytest.fixture(autouse=True)
def quick_peaks(monkeypatch):
    monkeypatch.setattr("ringlight.bench.record.fma_gflops", lambda: 3.0)
    monkeypatch.setattr("ringlight.bench.record.peak_gflops", lambda: 1.0)
    monkeypatch.setattr("ringlight.bench.record.copy_bandwidth", lambda: 2.0)


@pytest.mark.parametrize("what", SMALL)
def test_json_is_valid_and_complete(what, capsys):
    assert run(["bench", what, *SMALL[what], *QUICK, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    now = record["circumstances"]
    assert {"version", "commit", "date", "machine", "fma_gflops", "matrix_gflops", "copy_gbs", "load"} == set(now)
    assert len(now["date"].split("-")) == 3
    assert now["machine"]["isa"]
    assert record["rows"]


@pytest.mark.parametrize("what", SMALL)
def test_tables_fit_80_columns(what, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert run(["bench", what, *SMALL[what], *QUICK]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 5
    assert max(map(len, lines)) <= 80


def test_save_writes_what_json_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(["bench", "raster", "--sizes", "100@16", *QUICK, "--json", "--save", "small"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "benchmarks/results/small.json").read_text()) == printed


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["raster", "--sizes", "10x"], "'10x' is no size"),
        (["raster", "--save", "../x"], "no name for a result"),
        (["parts", "--sizes", "0@400"], "out of range"),
        (["parts", "shiny"], "no part is called"),
        (["step", "nerf"], "no method is called"),
        (["step", "--scene", "nowhere"], "nowhere"),
        (["step", "3dgs", "3dgs"], "a method twice"),
        (["step", "3dgs", "--after", "5"], "name them by --scene"),
        (["step", "3dgs", "--scene", "nowhere", "--gaussians", "-1"], "--gaussians is -1"),
    ],
)
def test_mistakes_are_one_sentence(words, sentence, capsys):
    assert run(["bench", *words]) == 1
    told = capsys.readouterr().err
    assert "compiling" not in told, "what can be seen at once is refused at once"
    complaint = told.strip().splitlines()[-1]
    assert complaint.startswith("ringlight: ")
    assert sentence in complaint


@pytest.mark.parametrize("words", [[], ["speed"], ["raster", "--chanels", "3"], ["parts", "--gaussians", "many"]])
def test_wrong_usage_ends_with_2(words, capsys):
    assert run(["bench", *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
