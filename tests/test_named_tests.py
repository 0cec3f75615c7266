"""A document that names a test, as FILE::NAME below tests/, names one that is there."""

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
DOCUMENTS = sorted((TESTS.parent / "docs").rglob("*.md"))
HERE = "cli/test_first_hour.py"
"""What the trials call so."""

NAMED = re.compile(r"([\w/]+\.py)::(\w+)")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_it_is_there(document: Path) -> None:
    for file, name in NAMED.findall(document.read_text(encoding="utf-8")):
        source = TESTS / file.removeprefix("tests/")
        assert re.search(rf"^def {name}\(", source.read_text(encoding="utf-8"), re.MULTILINE), f"{file}::{name}"


def test_every_finding_of_the_first_hour_names_one() -> None:
    trials = [file.read_text(encoding="utf-8") for file in sorted((TESTS / "first_hour").glob("*.py"))]
    named = [found for text in trials for found in NAMED.findall(text.replace("{HERE}", HERE))]
    assert len(named) > 50
    for file, name in named:
        if file != "FILE.py":
            assert re.search(rf"^def {name}\(", (TESTS / file).read_text(encoding="utf-8"), re.MULTILINE), name
