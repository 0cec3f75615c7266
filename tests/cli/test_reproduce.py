"""``ringlight reproduce``: the page of this repository is what the command writes."""

import json
from pathlib import Path

import pytest
from command import Command
from refusal import refused

ROOT = Path(__file__).parents[2]
RESULTS, PAGE = ROOT / "benchmarks" / "results", ROOT / "docs" / "reproduction.md"

pytestmark = pytest.mark.skipif(not RESULTS.is_dir(), reason="needs the repository's records")


def test_the_page_of_the_repository_is_what_the_command_writes(
    tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    copy = tmp_path / "reproduction.md"
    copy.write_text(PAGE.read_text())
    assert ringlight("reproduce", "--page", copy).code == 0
    assert copy.read_text().replace(str(copy), "docs/reproduction.md") == PAGE.read_text()


def test_it_prints_a_section_or_verdicts(ringlight: Command) -> None:
    assert "## Claim by claim" in ringlight("reproduce", "--results", RESULTS).out
    told = json.loads(ringlight("reproduce", "--results", RESULTS, "--json").out)
    assert {claim["where"] for claim in told["claims"]} >= {"table 1", "table 4", "table 5", "tables 2 and 3"}
    assert all(claim["because"] for claim in told["claims"])


def test_bad_input_is_a_sentence(tmp_path: Path, ringlight: Command) -> None:
    refused(ringlight("reproduce", "--results", tmp_path / "nowhere"), 1, "nowhere")
    page = tmp_path / "page.md"
    page.write_bytes(b"\xff\xfe\x00")
    refused(ringlight("reproduce", "--results", RESULTS, "--page", page), 1, page)
    assert page.read_bytes() == b"\xff\xfe\x00"
