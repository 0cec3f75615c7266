"""What new users met in their first hour, tried again on one version of the command or several.

    python tests/first_hour/run.py                                  this interpreter's
    python tests/first_hour/run.py --python OLD/bin/python --python NEW/bin/python --markdown
    python tests/first_hour/run.py --only H1 M4

Prints a line for each finding and version: what was expected, and what happened. Exit code 1 where the last version
does other than expected. docs/experiments/first-hour.md has the results.
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

sys.path.extend(str(Path(__file__).parents[1] / folder) for folder in ("cli", "data", "poses", ""))

import high_and_medium
import low
import remedies
import wishes
from tried import FINDINGS, Finding, Outcome, Tried

LONGEST = 100
"""Characters of what was seen that are shown."""

INSTALLED = re.compile(r"\S*/site-packages/")
"""Where this machine has its libraries says nothing."""

__all__ = ["high_and_medium", "low", "remedies", "wishes"]


def outcome(of: Finding, tried: Tried, home: Path) -> Outcome:
    """Of one trial; what goes wrong in it counts as not expected."""
    try:
        tried.begin(of.name)
        holds, seen = of.trial(tried)
    except Exception as error:  # the version under trial left nothing to look at
        holds, seen = False, f"{type(error).__name__}: {error}"
    seen = INSTALLED.sub("", seen.replace(str(tried.folder), ".").replace(str(home), ".."))
    return bool(holds), " ".join(seen.split())[:LONGEST]


def main() -> int:
    """Try every finding on every version."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", help="interpreter of a version; give it again for another")
    parser.add_argument("--only", nargs="*", default=[], help="findings whose names begin so")
    parser.add_argument("--markdown", action="store_true", help="print the table of the document")
    asked = parser.parse_args()
    pythons = asked.python or [sys.executable]
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="ringlight-first-hour-") as home:
        versions = [Tried(python, Path(home) / str(index)) for index, python in enumerate(pythons)]
        for tried in versions:
            tried.home.mkdir()
        for of in FINDINGS:
            if asked.only and not of.name.startswith(tuple(asked.only)):
                continue
            seen = [outcome(of, tried, Path(home)) for tried in versions]
            wrong += not seen[-1][0]
            show(of, seen, asked.markdown)
    return int(wrong > 0)


def show(of: Finding, seen: list[Outcome], markdown: bool) -> None:
    """As a row of the document's table, or as a line for each version."""
    if markdown:
        cells = ["holds" if holds else words.replace("|", "\\|") for holds, words in seen]
        print(f"| {of.name} | {of.expected} | {' | '.join(cells)} | {of.test} |", flush=True)  # noqa: T201
        return
    print(f"{of.name}: {of.expected}", flush=True)  # noqa: T201
    for holds, words in seen:
        print(f"    {'ok ' if holds else 'NOT'}  {words}", flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
