"""The flags that a record becomes on the command line, to tell a person what a word should have been."""

import dataclasses
from difflib import get_close_matches
from typing import Any, get_args, get_type_hints


def flags_of(record: Any, in_pairs: bool = False) -> set[str]:
    """``--steps``, ``--light.mask``, ...: of a record with its settings, or of a class of records with defaults.

    ``in_pairs``: what is on or off has a flag for each, ``--light.no-mask`` too.
    """
    flags = set()
    hints = get_type_hints(record if isinstance(record, type) else type(record))
    for field in dataclasses.fields(record):
        name, value, kind = field.name.replace("_", "-"), _value(record, field), hints[field.name]
        if dataclasses.is_dataclass(value):
            flags |= {f"--{name}.{inner.removeprefix('--')}" for inner in flags_of(value, in_pairs)}
            continue
        flags.add(f"--{name}")
        if in_pairs and bool in (kind, *get_args(kind)):
            flags.add(f"--no-{name}")
    return flags


def flags_in(arguments: list[str]) -> list[str]:
    """The flags that were given, as they are declared: without values, with hyphens."""
    return [word.split("=")[0].replace("_", "-") for word in arguments if word.startswith("--") and len(word) > 2]


def near(flag: str, flags: set[str]) -> str | None:
    """The flag that was probably meant: one that goes on like it, one whose last part it is, or one spelt alike."""
    tail = flag.removeprefix("--")
    longer = [known for known in sorted(flags) if known.startswith(flag) or known.split(".")[-1] == tail]
    return next(iter(longer or get_close_matches(flag, sorted(flags), n=1)), None)


def _value(record: Any, field: "dataclasses.Field[Any]") -> Any:
    if not isinstance(record, type):
        return getattr(record, field.name)
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
