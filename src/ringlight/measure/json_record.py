"""Frozen dataclasses as JSON and back, strictly: a wrong or missing field is one sentence, an unknown one is skipped.

Infinity and NaN are written as the strings "inf", "-inf" and "nan"; null means that something was not measured.
"""

import json
import types
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from ringlight.core.json_numbers import NON_FINITE, refuse_constant, spelled
from ringlight.errors import RunError

Record = TypeVar("Record")

LARGEST_COUNT = 2**63 - 1
"""Nothing that is counted is more; what is far beyond cannot even be a float."""

REMEDY = "measure the run again with 'ringlight eval'"


def to_json(record: object) -> str:
    """The record as valid, indented JSON in ASCII, with the fields in the order of their declaration."""
    return json.dumps(spelled(record), indent=2, allow_nan=False) + "\n"


def from_json(kind: type[Record], text: str, source: str) -> Record:
    """The record that ``to_json`` wrote; fields that this version does not know are skipped.

    Raises:
        RunError: not JSON, a field without default is missing, or a field has another type; ``source`` names the file.
    """
    try:
        data = json.loads(text, parse_constant=refuse_constant)
    except (ValueError, RecursionError) as error:
        raise RunError(f"{source}: not valid JSON ({error}); {REMEDY}") from None
    result: Record = _decode(kind, data, "the record", source)
    return result


def _decode(kind: Any, value: Any, name: str, source: str) -> Any:
    """``value`` as ``kind``: a dataclass, str, int, float, ``X | None``, ``dict[str, X]`` or ``tuple[X, ...]``."""
    if get_origin(kind) in (Union, types.UnionType):
        inner = next(option for option in get_args(kind) if option is not type(None))
        return None if value is None else _decode(inner, value, name, source)
    if is_dataclass(kind) and isinstance(value, dict):
        return _decode_record(kind, value, name, source)
    if get_origin(kind) is dict and isinstance(value, dict):
        return {key: _decode(get_args(kind)[1], item, f"{name}.{key}", source) for key, item in value.items()}
    if get_origin(kind) is tuple and isinstance(value, list):
        return tuple(_decode(get_args(kind)[0], item, f"{name}[{i}]", source) for i, item in enumerate(value))
    if kind is int and type(value) is int and abs(value) <= LARGEST_COUNT:  # true is an int in Python, but no count
        return value
    if kind is str and type(value) is str:
        return value
    if kind is float and (value in NON_FINITE or type(value) in (int, float)):
        with suppress(OverflowError):  # an integer of more than 308 digits
            return float(value)
    wanted = getattr(kind, "__name__", str(kind))
    raise RunError(f"{source}: {name} is not of type {wanted}; {REMEDY}")


def _decode_record(kind: Any, value: dict[str, Any], name: str, source: str) -> Any:
    hints = get_type_hints(kind)
    found = {}
    for field in fields(kind):
        if field.name in value:
            found[field.name] = _decode(hints[field.name], value[field.name], field.name, source)
        elif field.default is MISSING and field.default_factory is MISSING:
            raise RunError(f"{source}: '{field.name}' is missing in {name}; {REMEDY}")
    return kind(**found)
