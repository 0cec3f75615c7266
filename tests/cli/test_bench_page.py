"""``ringlight bench page``: what it counts is what the page draws; without a browser it is one sentence."""

import json
import stat
from pathlib import Path

import pytest
from command import Command
from refusal import refused

from ringlight.bench import browser as browsers
from ringlight.bench.page import NOTE_FIRST, SCRIPTS
from ringlight.errors import BackendError

PAGE = ("bench", "page", "--rounds", "2", "--threads", "1")


@pytest.fixture(autouse=True)
def quick_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("fma_gflops", "peak_gflops", "copy_bandwidth"):
        monkeypatch.setattr(f"ringlight.bench.record.{name}", lambda: 1.0)


@pytest.fixture
def program() -> str:
    try:
        return browsers.find_browser()
    except BackendError as error:
        pytest.skip(str(error))


def test_a_run_and_its_page_are_measured_at_each_size(
    program: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    source, page = trained["ringlight-basis"], tmp_path / "a <b> #1.html"
    assert ringlight("share", source, page).code == 0
    record = json.loads(ringlight(*PAGE, source, page, "--sides", "40", "64", "--json").out)
    assert record["sorted"] == 300_000
    assert record["sort_ms"] > 0
    assert record["renderer"]
    rows = record["rows"]
    assert [(row["name"], row["side"]) for row in rows] == [
        (name, side) for name in (source.name, page.name) for side in (40, 64)
    ]
    for row in rows:
        assert (row["kind"], row["pictures"]) == ("basis", 2)
        assert row["bytes_page"] == page.stat().st_size
        assert min(row[name] for name in ("first_ms", "picture_ms", "recolored_ms")) > 0
        assert row["seen"] > 0
        assert row["tests_per_pixel"] == row["entries"] * 64 / row["side"] ** 2
        # Lists, ellipses and one texel of channels are read, ellipses, lists and pixels are written.
        assert row["bytes_picture"] == row["entries"] * 56 + row["seen"] * 32 + row["side"] ** 2 * 4
    assert rows[0]["entries"] < rows[1]["entries"]
    assert rows[0]["entries"] == rows[2]["entries"], "a page is measured alike, however it came"


@pytest.mark.parametrize(("method", "texels"), [("ringlight-basis", 1), ("ringlight-mirror", 4)])
def test_colours_are_made_anew_once_and_their_texels_counted(
    program: str, method: str, texels: int, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    source, page = tmp_path / "run", tmp_path / "page.html"
    assert ringlight("train", tiny, method, "--steps", "8", "--out", source, "--quiet").code == 0
    assert ringlight("share", source, page, "--quiet").code == 0
    scripts = SCRIPTS.read_text("utf-8")
    count = """(async () => {
      const { recolor } = ringlight.viewer.picture.kind.colored, draw = recolor.draw;
      await picture(1);
      let times = 0;
      recolor.draw = (...given) => (times++, draw.apply(recolor, given));
      await picture(0);
      return times;
    })()"""
    with browsers.opened_browser(program) as browser:
        browser.open(f"{page.resolve().as_uri()}#bare", 40, 40, NOTE_FIRST)
        assert browser.value(f"{scripts}first()")["texels"] == texels
        assert browser.value(f"{scripts}{count}") == 1


def test_without_a_browser_it_is_one_sentence(
    trained: dict[str, Path], ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(browsers.NAMED_BY, raising=False)
    monkeypatch.setenv("PATH", "")
    refused(ringlight(*PAGE, trained["3dgs"]), 1, "no Chromium on PATH; install", "--browser FILE")
    monkeypatch.setenv(browsers.NAMED_BY, "/no/such/browser")
    refused(ringlight(*PAGE, trained["3dgs"]), 1, "/no/such/browser is no program")


def test_a_program_that_is_no_browser_is_one_sentence(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    other = tmp_path / "browser"
    other.write_text("#!/bin/sh\nexit 3\n")
    other.chmod(other.stat().st_mode | stat.S_IXUSR)
    refused(ringlight(*PAGE, trained["3dgs"], "--browser", other), 1, "has ended before it answered")


def test_what_cannot_be_measured_is_one_sentence(
    program: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    refused(ringlight(*PAGE), 1, "nothing to show")
    refused(ringlight(*PAGE, tmp_path / "none"), 1, "no such run")
    for side in ("0", "5000"):
        refused(ringlight(*PAGE, trained["3dgs"], "--sides", side), 1, f"--sides are {side}")
    other = tmp_path / "other.html"
    other.write_text("<!doctype html><title>another page</title>")
    refused(ringlight(*PAGE, other), 1, "no page that 'ringlight share' wrote")


def test_the_tables_fit_80_columns(
    program: str, trained: dict[str, Path], ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = ringlight(*PAGE, trained["3dgs"], "--sides", "1080", "--rounds", "1").out.splitlines()
    assert any("1080x1080" in line for line in lines)
    assert max(map(len, lines)) <= 80
