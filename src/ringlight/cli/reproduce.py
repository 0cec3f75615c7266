"""``ringlight reproduce``: the paper's claims one by one, held against records of ours."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ringlight.cli.parse import parse
from ringlight.core.command_line import command
from ringlight.errors import OutputError


@dataclass(frozen=True)
class ReproduceArguments:
    """Hold the paper's claims against records of runs, tables and studies: reproduced, not reproduced, or why it cannot
    be tested.

    Reads train-*.json, readme-*.json, table-*.json and study-*.json. Prints Markdown, or fills its section of --page
    and leaves all else as it is. Nothing is trained; each table says the command that makes its records.
    """

    results: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("benchmarks/results")
    """Folder of records."""
    page: Annotated[Path | None, tyro.conf.arg(metavar="FILE.md")] = None
    """Page whose section is written; without it the section is printed."""
    json: bool = False
    """Print the verdicts as JSON."""


def main(arguments: list[str]) -> int:
    """Judge and write; returns the exit code."""
    asked = parse(ReproduceArguments, "reproduce", arguments)
    from ringlight.files.atomic import write_text
    from ringlight.measure.claim_page import all_judged, claim_section, filled
    from ringlight.measure.claim_records import records_in
    from ringlight.measure.claims import paper_claims
    from ringlight.measure.json_record import to_json

    paper = paper_claims()
    found = all_judged(paper, records_in(asked.results))
    if asked.json:
        listed = [
            {
                "where": judgement.claim.table.where,
                "data_set": judgement.claim.data_set,
                "of": judgement.claim.own.name,
                "beside": judgement.claim.other.name,
                "measures": judgement.verdicts,
                "because": judgement.because,
            }
            for judgement in found
        ]
        sys.stdout.write(to_json({"paper": paper.paper, "claims": listed}))
    words = ["--results", str(asked.results)] if asked.results != Path("benchmarks/results") else []
    section = claim_section(paper, found, command("reproduce", *words, "--page", asked.page or "PAGE.md"))
    if asked.page is None:
        sys.stdout.write("" if asked.json else section)
        return 0
    try:
        page = asked.page.read_text(encoding="utf-8") if asked.page.exists() else "# Reproduction\n"
    except (OSError, ValueError) as error:
        raise OutputError(f"{asked.page}: cannot be read as text ({error}); name a Markdown page") from None
    write_text(asked.page, filled(page, section, str(asked.page)))
    return 0
