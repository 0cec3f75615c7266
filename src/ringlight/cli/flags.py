"""The flags that a record becomes on the command line, to tell a person what a word should have been."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
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


def near(flag: str, flags: set[str]) -> str | None:
    """The flag that was probably meant: one that goes on like it, one whose last part it is, or one spelt alike."""
    tail = flag.removeprefix("--")
    longer = [known for known in sorted(flags) if known.startswith(flag) or known.split(".")[-1] == tail]
    return next(iter(longer or get_close_matches(flag, sorted(flags), n=1)), None)
