"""Command lines to records, through tyro; wrong usage is one sentence and exit code 2."""

import contextlib
import io
import re
import sys
from typing import Any, NoReturn, TypeVar

import tyro

from ringlight.cli.main import WRONG_USAGE

Arguments = TypeVar("Arguments")


def parse(kind: "type[Arguments]", verb: str, arguments: list[str]) -> Arguments:
    """The record ``kind`` filled from the command line. Exits 0 after ``--help``, 2 after one sentence."""
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            parsed: Any = tyro.cli(
                kind,
                prog=f"ringlight {verb}",
                args=arguments,
                config=(tyro.conf.CascadeSubcommandArgs, tyro.conf.FlagCreatePairsOff),
            )
            return parsed
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        refuse(verb, one_sentence(complaint.getvalue()))


def refuse(verb: str, sentence: str) -> NoReturn:
    """Wrong usage: one sentence on standard error, exit code 2."""
    sys.stderr.write(f"ringlight {verb}: {sentence}; see 'ringlight {verb} --help'\n")
    raise SystemExit(WRONG_USAGE) from None


def one_sentence(box: str) -> str:
    """The content of tyro's framed complaint on one line, without its frame and its own pointer to the help."""
    lines = [re.sub(r"[│╭╮╰╯─]+", " ", line).strip() for line in box.splitlines()]
    text = " ".join(line for line in lines if line)
    text = re.sub(r"For full helptext,.*", "", text)
    title, _, rest = text.partition("  ")
    text = re.sub(r"\s+", " ", rest or title).strip()
    return re.sub(r"^(Unrecognized options|Required options|Parsing error) (?=\S)", "", text)
