"""Numbers that JSON has not: infinity and NaN are spelled as strings where they are honest, and refused elsewhere.

Both occur in honest measurements: the PSNR of a perfect picture is infinite. Python writes them as bare words, which
other readers call damage.
"""

import math
import sys
from dataclasses import fields, is_dataclass
from typing import Any

NON_FINITE = ("inf", "-inf", "nan")
"""As Python writes and reads them."""


def spelled(value: Any) -> Any:
    """The same without a float that JSON has not; dataclasses become objects, with fields in their order."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: spelled(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {key: spelled(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [spelled(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def read_back(value: Any) -> Any:
    """What :func:`spelled` made of measures or settings, whose strings are none of these words."""
    if isinstance(value, dict):
        return {key: read_back(item) for key, item in value.items()}
    if isinstance(value, list):
        return [read_back(item) for item in value]
    return float(value) if isinstance(value, str) and value in NON_FINITE else value


def without_infinity(value: Any) -> Any:
    """The same with the largest number in place of infinity, which settings of earlier versions may be: what compares
    with them finds both alike."""
    if isinstance(value, dict):
        return {key: without_infinity(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_infinity(item) for item in value]
    return sys.float_info.max if value == math.inf else value


def refuse_constant(name: str) -> float:
    """For json's ``parse_constant``. Raises ValueError: NaN and Infinity are no JSON."""
    raise ValueError(f"{name} is not JSON")
