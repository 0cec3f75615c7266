"""A model's packed tensors as one deflated block of bytes, laid out so that deflating finds what is alike.

The numbers are those of ``ringlight compress``; only their order differs. Columns of the table stand one after the
other, since neighbouring rows are neighbours in space, and positions are differences from row to row. Before
deflating: four bytes with the length of a JSON header, the header, and the parts, each on a multiple of eight bytes.
"""

import json
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ringlight.core.gradients import COLUMNS
from ringlight.files.packed import SEPARATOR, Packed
from ringlight.files.packing_plan import MEANS
from ringlight.files.page.blurred_light import MAPS, SHARES

ALIGNED = 8
"""Bytes; a 64-bit array in a browser begins at such a multiple."""

TYPES = {
    "uint8": "u8",
    "int8": "i8",
    "float16": "u16",
    "float32": "f32",
    "float64": "f64",
    "int64": "i64",
    "bool": "u8",
}
"""NumPy's names and the page's; half floats go as their bits, since old browsers know no such arrays."""

SMOOTH = (MEANS, MAPS, SHARES)
"""Ends of names of what is alike from row to row; their codes are whole numbers of a byte or more."""

MOST_EFFORT = 9

LONGEST_NUMBER = 20
"""Digits of the largest length."""


def payload_of(packed: Packed, others: Mapping[str, Tensor], texts: Mapping[str, str] | None = None) -> bytes:
    """Deflated (zlib's format); ``others`` are kept as they are, ``texts`` by name go into the header."""
    parts: list[dict[str, object]] = []
    chunks: list[bytes] = []
    at = 0
    for stored, tensor in (packed.tensors | dict(others)).items():
        name, _, part = stored.partition(SEPARATOR)
        array = tensor.detach().cpu().contiguous().numpy()
        order, laid = _laid_out(name, part, array)
        data = laid.tobytes()
        parts.append(
            {
                "tensor": name,
                "part": part,
                "type": TYPES[str(array.dtype)],
                "shape": list(array.shape),
                "count": int(array.size),
                "order": order,
                "at": at,
            }
        )
        padded = data + bytes(-len(data) % ALIGNED)
        chunks.append(padded)
        at += len(padded)
    described = {"parts": parts, "packing": packed.packing, "texts": dict(texts or {})}
    # The header says where the parts begin, which depends on its own length: room for that number is made first.
    start = 4 + len(_json(described | {"start": 0})) + LONGEST_NUMBER
    start += -start % ALIGNED
    header = _json(described | {"start": start})
    head = len(header).to_bytes(4, "little") + header.encode("ascii")
    return zlib.compress(head.ljust(start, b" ") + b"".join(chunks), MOST_EFFORT)


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def _laid_out(name: str, part: str, array: NDArray[np.generic]) -> tuple[str, NDArray[np.generic]]:
    """How the page shall read it, and the array in that order."""
    if array.ndim < 2 or array.size == 0:
        return "rows", array
    if name.endswith(SMOOTH) and part == "codes":
        return "steps", _columns_first(_row_steps(array))
    if not name.startswith(COLUMNS):
        return "rows", array
    return "planes", _columns_first(array)


def _columns_first(array: NDArray[np.generic]) -> NDArray[np.generic]:
    return np.ascontiguousarray(array.reshape(len(array), -1).T)


def _row_steps(codes: NDArray[np.generic]) -> NDArray[np.generic]:
    """Bytes [N 3 W] of whole numbers as those of their differences from row to row, modulo their range: even codes for
    steps up, odd ones for steps down."""
    width = codes.shape[-1]
    span = 1 << 8 * width
    places = 8 * np.arange(width)
    whole = (codes.astype(np.int64) << places).sum(-1)
    steps = np.diff(whole, axis=0, prepend=0) % span
    steps = np.where(steps >= span // 2, steps - span, steps)
    folded = np.where(steps < 0, -2 * steps - 1, 2 * steps)
    return ((folded[..., None] >> places) & 0xFF).astype(np.uint8)
