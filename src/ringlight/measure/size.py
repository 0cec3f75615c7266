"""Bytes that rendering needs, counted by part, so that no network or table is forgotten."""

from collections.abc import Mapping

from jaxtyping import Shaped
from torch import Tensor

from ringlight.core.raw_bytes import raw_bytes

PART_DEPTH = 2
"""Dotted levels of a tensor's name that make a part: "color.ring.cores.0" belongs to "color.ring"."""


def bytes_by_part(tensors: Mapping[str, Shaped[Tensor, "..."]]) -> dict[str, int]:
    """Bytes of every tensor that rendering needs (columns, networks, tables, buffers), summed by part.

    Floating-point tensors count 4 bytes an element, all others as stored. Parts come in the order of the tensors.
    """
    parts: dict[str, int] = {}
    for name, tensor in tensors.items():
        part = ".".join(name.split(".")[:PART_DEPTH])
        parts[part] = parts.get(part, 0) + raw_bytes(tensor)
    return parts
