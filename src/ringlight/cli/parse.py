"""Command lines to records, through tyro; wrong usage is one sentence and exit code 2."""

import contextlib
import io
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import tyro

from ringlight.cli.flags import joined, lists_of
from ringlight.cli.help_text import REGISTRY, joined_lines
from ringlight.cli.main import WRONG_USAGE
from ringlight.cli.streams import Lasting

Arguments = TypeVar("Arguments")


def parse(
    kind: "type[Arguments]", verb: str, arguments: list[str], in_pairs: bool = False, before: str = "", of: str = ""
) -> Arguments:
    """The record ``kind`` filled from the command line. Exits 0 after ``--help``, 2 after one sentence.

    With ``in_pairs`` what is on or off gets two flags, ``--x`` and ``--no-x``, unless marked otherwise: settings whose
    default is not the same in all methods, or left to the scene. ``before`` is what the help of a subcommand shows
    before its name, which is ``of``.
    """
    markers = (tyro.conf.CascadeSubcommandArgs, tyro.conf.DisallowNone)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint), contextlib.redirect_stdout(_drawn_help()), joined_lines():
            parsed: Any = tyro.cli(
                kind,
                prog=f"ringlight {verb} {before}".rstrip(),
                args=joined(arguments, lists_of(kind)),
                config=markers if in_pairs else (*markers, tyro.conf.FlagCreatePairsOff),
                registry=REGISTRY,
            )
            return parsed
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        refuse(verb, one_sentence(complaint.getvalue(), arguments), f"{before} {of}" if of else "")


def _drawn_help() -> Any:
    """Standard output on which the help may be coloured."""
    return sys.stdout.drawing() if isinstance(sys.stdout, Lasting) else sys.stdout


def refuse(verb: str, sentence: str, of: str = "") -> NoReturn:
    """Wrong usage: one sentence on standard error, exit code 2. Words ``of`` a subcommand go before ``--help``."""
    explained = f"{verb} {of}".rstrip()
    sys.stderr.write(f"ringlight {verb}: {sentence}; see 'ringlight {explained} --help'\n")
    raise SystemExit(WRONG_USAGE) from None


def one_sentence(box: str, arguments: Sequence[str]) -> str:
    """What tyro's framed complaint of these ``arguments`` says, on one line, without its frame and its pointer to the
    help."""
    box = re.sub(COLOR, "", box)
    # The frame is drawn with lines or, where the terminal knows no such characters, with blanks and hyphens.
    inside = [line[2:].rstrip(" │") for line in box.splitlines()[1:] if not line.startswith("╰")]
    sections = [section for section in re.split(RULE, "\n".join(inside)) if section.strip()]
    hints = [hint for section in sections[1:] for hint in _hints(section.strip("\n"))]
    return "; ".join([_complaint(sections[0].strip("\n")), *hints, *_unquoted(arguments)])


COLOR = r"\x1b\[[0-9;]*m"
"""On a terminal tyro paints its complaint."""

RULE = r"(?m)^[-─]{10,}$"
"""Between the sections of a complaint, and under its title."""

PLAIN_WORDS = (
    (r"invalid literal for int\(\) with base 10: (.*)", r"\1 is not a whole number"),
    (r"could not convert string to float: (.*)", r"\1 is not a number"),
    (r"Missing value for argument '(.*)'\. Expected 1 values", r"a value is missing for \1"),
    (r"^Error parsing (--\S+):", r"\1:"),
    (r" \(applied to [^)]*\)", ""),
    (r" Arguments are applied to the directly preceding.*", ""),
    (r"^Expected one of \{(.*)\}\.?$", r"a word is missing: expected one of \1"),
    (r" for argument 'what'", " for STUDY"),
    (r"^Unrecognized(?: or misplaced)? options:", "not understood:"),
)
"""Python's and tyro's words, and those for a person."""


def _complaint(section: str) -> str:
    if section.startswith("Missing from"):
        return "missing: " + ", ".join(re.findall(r"^    (\S.*)$", section, re.MULTILINE))
    text = " ".join(section.split())
    for pattern, words in PLAIN_WORDS:
        text = re.sub(pattern, words, text)
    return text.rstrip(". ")


def _exists(name: str) -> bool:
    with contextlib.suppress(OSError, ValueError):  # too long for a name, or none
        return Path(name).exists()
    return False


def _unquoted(arguments: Sequence[str]) -> list[str]:
    """What to do where words beside each other are the name of a file or folder."""
    words = [" ".join(arguments[at : end + 1]) for at in range(len(arguments)) for end in range(at + 1, len(arguments))]
    return [f"a name with blanks needs quotes: '{name}'" for name in words if _exists(name)][:1]


def _hints(section: str) -> list[str]:
    """Flags that are near to the one that was given, with the words they go with; the words that were expected."""
    if section.startswith("Available subcommands:"):
        return ["expected one of " + " ".join(section.split()[2:])]
    if not section.startswith("Perhaps you meant"):
        return []
    flags = re.findall(r"^    (--\S+)", section, re.MULTILINE)
    owners = re.findall(r"^        in (?:ringlight )(\S+) --help", section, re.MULTILINE)
    belongs = f" of {', '.join(dict.fromkeys(owners))}" if owners else ""
    return [f"perhaps you meant {flags[0]}{belongs}"] if flags else []
