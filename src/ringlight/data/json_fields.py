"""Typed reading of JSON that a stranger wrote: a wrong type is a sentence, not a traceback."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from ringlight.data.folder import read_bytes
from ringlight.errors import SceneError

Fields = Mapping[str, Any]
"""One JSON object."""

Default = TypeVar("Default", float, None)


def read_object(path: Path) -> Fields:
    """The JSON object in a file.

    Raises:
        SceneError: unreadable, not JSON, or JSON of another kind.
    """
    try:
        document = json.loads(read_bytes(path))
    except (ValueError, RecursionError) as error:
        reason = str(error) if isinstance(error, json.JSONDecodeError) else type(error).__name__
        raise SceneError(f"{path}: not valid JSON ({reason}); copy or export the file again") from error
    if not isinstance(document, dict):
        raise SceneError(f"{path}: holds no JSON object with 'frames'; export the cameras again")
    return document


def number(fields: Fields, name: str, where: str, otherwise: Default) -> float | Default:
    """The finite number called ``name``, or ``otherwise`` where it is absent.

    Raises:
        SceneError: present, but not a finite number.
    """
    return finite(fields[name], f"{where}: {name!r}") if name in fields else otherwise


def finite(value: object, what: str) -> float:
    """``value`` as a float, or a SceneError saying that ``what`` is not a finite number."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            converted = float(value)
        except OverflowError:  # an integer of more than 308 digits
            converted = math.inf
        if math.isfinite(converted):
            return converted
    raise SceneError(f"{what} is not a finite number; correct it or export the cameras again")


def text(fields: Fields, name: str, where: str) -> str | None:
    """The string called ``name``, or None where it is absent; SceneError if it is something else or empty."""
    if name not in fields:
        return None
    value = fields[name]
    if not isinstance(value, str) or not value:
        raise SceneError(f"{where}: {name!r} is not a name; correct it or export the cameras again")
    return value


def texts(fields: Fields, name: str, where: str) -> list[str] | None:
    """The list of strings called ``name``, or None where it is absent; SceneError if it is something else."""
    if name not in fields:
        return None
    values = fields[name]
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise SceneError(f"{where}: {name!r} is not a list of names; correct it or remove it")
    return values


def pose_matrix(fields: Fields, where: str) -> Float[np.ndarray, "4 4"]:
    """The ``transform_matrix``: 4 x 4, or 3 x 4 with the last row understood.

    Raises:
        SceneError: absent, of another shape, or with an entry that is not a finite number.
    """
    return matrix_of(fields, "transform_matrix", where, "export the cameras again, or remove the frame")


def matrix_of(fields: Fields, name: str, where: str, remedy: str) -> Float[np.ndarray, "4 4"]:
    """The matrix called ``name``, as :func:`pose_matrix` reads one."""
    what = f"{where}: {name!r}"
    rows = fields.get(name)
    if not isinstance(rows, list) or len(rows) not in (3, 4):
        raise SceneError(f"{what} is not a matrix of 4 rows; {remedy}")
    matrix = np.eye(4)
    for index, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != 4:
            raise SceneError(f"{what} has a row without 4 numbers; {remedy}")
        matrix[index] = [finite(value, f"{where}: an entry of {name!r}") for value in row]
    return matrix
