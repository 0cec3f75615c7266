"""How the help shows what docstrings and types say: paragraphs without the source's line breaks, no Python words."""

import dataclasses
import inspect
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any, get_args

import docstring_parser
import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

UNSAID = tyro.conf.arg(help_behavior_hint="")

REGISTRY = ConstructorRegistry()
"""Types that the parser of the command line would show otherwise."""


@REGISTRY.primitive_rule
def _optional(info: PrimitiveTypeInfo) -> "PrimitiveConstructorSpec[Any] | None":
    """``int | None`` is shown and read as a whole number: who wants None leaves the flag out."""
    inner = [kind for kind in get_args(info.type) if kind is not type(None)]
    if len(inner) != 1 or type(None) not in get_args(info.type):
        return None
    spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(inner[0], set(info.markers)))
    if not isinstance(spec, PrimitiveConstructorSpec):
        return None
    return replace(
        spec,
        is_instance=lambda value: value is None or spec.is_instance(value),
        str_from_instance=lambda value: ["None"] if value is None else spec.str_from_instance(value),
    )


_being_read: set[type] = set()


@REGISTRY.struct_rule
def _open_settings(info: StructTypeInfo) -> StructConstructorSpec | None:
    """After a setting that is left open, or empty, the help says no default: "None" would tell nobody anything."""
    if not dataclasses.is_dataclass(info.type) or info.type in _being_read:
        return None
    _being_read.add(info.type)  # so that the parser's own rule is asked
    try:
        spec = ConstructorRegistry.get_struct_spec(info)
    finally:
        _being_read.remove(info.type)
    if not isinstance(spec, StructConstructorSpec):
        return None
    return replace(spec, fields=tuple(_without_default(f) if f.default in (None, ()) else f for f in spec.fields))


def _without_default(field: StructFieldSpec) -> StructFieldSpec:
    return replace(field, type=Annotated[field.type, UNSAID])  # type: ignore[arg-type]


def _as_typed(quoted: re.Match[str]) -> str:
    """A setting's name as its flag, any other quoted word as it is."""
    word = quoted[1]
    return f"--{word.replace('_', '-')}" if "_" in word else word


@contextmanager
def joined_lines() -> Iterator[None]:
    """Inside the block a field's docstring loses its indentation, which the parser takes for the end of a paragraph."""
    read = docstring_parser.parse_from_object

    def parse_from_object(*arguments: Any, **options: Any) -> docstring_parser.Docstring:
        parsed = read(*arguments, **options)
        for parameter in parsed.params:
            if parameter.description is not None:
                joined = " ".join(inspect.cleandoc(parameter.description).splitlines())
                parameter.description = re.sub(r"``([^`]+)``", _as_typed, joined)
        return parsed

    docstring_parser.parse_from_object = parse_from_object
    try:
        yield
    finally:
        docstring_parser.parse_from_object = read
