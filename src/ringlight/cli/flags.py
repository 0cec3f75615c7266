"""The flags that a record becomes on the command line, to tell a person what a word should have been."""

import re
from collections.abc import Container, Sequence
from dataclasses import fields, is_dataclass
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path
from typing import Any, get_args, get_type_hints

from ringlight.errors import RecipeError


def flags_of(record: Any, in_pairs: bool = False) -> set[str]:
    """``--steps``, ``--light.mask``, ...: of a class of records.

    ``in_pairs``: what is on or off has a flag for each, ``--light.no-mask`` too.
    """
    flags = set()
    hints = get_type_hints(record)
    for field in fields(record):
        name, kind = field.name.rstrip("_").replace("_", "-"), hints[field.name]
        if is_dataclass(kind):
            flags |= {f"--{name}.{inner.removeprefix('--')}" for inner in flags_of(kind, in_pairs)}
            continue
        flags.add(f"--{name}")
        if in_pairs and bool in (kind, *get_args(kind)):
            flags.add(f"--no-{name}")
    return flags


def flags_in(arguments: list[str]) -> list[str]:
    """The flags that were given, as they are declared: without values, with hyphens."""
    return [word.split("=")[0].replace("_", "-") for word in arguments if word.startswith("--") and len(word) > 2]


def lists_of(record: Any) -> set[str]:
    """Those of :func:`flags_of` that take any number of values; not of records in it."""
    hints = get_type_hints(record)
    return {f"--{name.replace('_', '-')}" for name, hint in hints.items() if get_args(hint)[1:] == (...,)}


def joined(arguments: Sequence[str], lists: Container[str]) -> list[str]:
    """The same line with the values of all flags of a name behind the first one, if it is among ``lists``: to a parser
    the last flag takes the place of those before it, and who writes ``--set a --set b`` wants both."""
    found: list[list[str]] = [[]]
    firsts: dict[str, list[str]] = {}
    for word in arguments:
        flag, _, value = word.partition("=")
        flag = flag.replace("_", "-")
        if not flag.startswith("--") or flag == "--":
            found[-1].append(word)
        elif flag in lists and flag in firsts:
            # Words up to the next flag are values of this one, and go with those of the first.
            found.append(firsts[flag])
            found[-1] += [value] if value else []
        else:
            found.append([flag, value] if value and flag in lists else [word])
            firsts.setdefault(flag, found[-1])
    return [word for part in {id(part): part for part in found}.values() for word in part]


SETTING = r"(?<![-./\\\w])[a-z][a-z0-9]*(?:[._][a-z0-9]+)*(?![-./\\]?\w|:)"
"""A word that may name a setting in a record: ``steps``, ``densify.reset_opacity``; no part of a flag or a path."""


def by_flag(sentence: str, arguments: list[str]) -> str:
    """The sentence with settings named as the command line gave them: ``--densify.reset-opacity`` for
    ``densify.reset_opacity``. A plain word is one only at the beginning. What was not given keeps its name, and so does
    a word that was given itself: a folder may be called like a setting."""
    given = set(flags_in(arguments))

    def flag(found: re.Match[str]) -> str:
        word = found[0]
        of_word = f"--{word.replace('_', '-')}"
        is_setting = found.start() == 0 or "_" in word or "." in word
        return of_word if is_setting and of_word in given and word not in arguments else word

    return re.sub(SETTING, flag, sentence)


def behind_values(arguments: list[str], flag: str, values: Sequence[str]) -> list[str]:
    """The same line with words that follow the ``values`` of ``flag``, and are none, put before all flags.

    A flag of several values takes every word up to the next flag, folders too: ``--lpips vgg SCENE``. Raises
    RecipeError where the first of them looks like a value that is misspelt.
    """
    if flag not in arguments:
        return arguments
    first = arguments.index(flag) + 1
    if first < len(arguments) and _is_misspelt(arguments[first], values):
        raise RecipeError(f"{flag} is {arguments[first]!r}; give some of {' '.join(values)}, with blanks between")
    end = next((at for at in range(first, len(arguments)) if arguments[at].startswith("-")), len(arguments))
    last = next((at for at in range(first, end) if arguments[at] not in values), end)
    at = next((place for place, word in enumerate(arguments) if word.startswith("-")), len(arguments))
    return [*arguments[:at], *arguments[last:end], *arguments[at:last], *arguments[end:]]


def _is_misspelt(word: str, values: Sequence[str]) -> bool:
    return (
        word not in values and ("," in word or bool(get_close_matches(word, values, n=1))) and not Path(word).exists()
    )


def near(flag: str, flags: set[str], others: set[str] | None = None) -> str | None:
    """The flag that was probably meant: one that goes on like it, one whose last part or words it is, or one spelt
    alike; of equals rather one of ``flags`` than of the ``others``."""
    pools = [sorted(flags), sorted(others or ())]
    by_name = [known for pool in pools for known in _continued(flag, pool)]
    alike = [known for pool in pools for known in get_close_matches(flag, pool, n=1)]
    alike.sort(key=lambda known: -SequenceMatcher(None, flag, known).ratio())
    return next(iter(by_name or alike), None)


def _continued(flag: str, flags: list[str]) -> list[str]:
    tail = flag.removeprefix("--")
    longer = [known for known in flags if known.startswith(flag) or known.split(".")[-1] == tail]
    return longer + [known for known in flags if known.endswith(f"-{tail}")]
