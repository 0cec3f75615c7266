"""Raw sizes count every real number at 32 bit, however it is stored, so that methods compare."""

from collections.abc import Mapping

from jaxtyping import Shaped
from torch import Tensor

FLOAT_BYTES = 4

PART_DEPTH = 2
"""Dotted levels of a tensor's name that make a part: "color.ring.cores.0" belongs to "color.ring"."""


def raw_bytes(tensor: Shaped[Tensor, "..."]) -> int:
    """Bytes of a tensor: 4 an element if these are real numbers, else as stored."""
    return tensor.numel() * (FLOAT_BYTES if tensor.is_floating_point() else tensor.element_size())


def bytes_by_part(tensors: Mapping[str, Shaped[Tensor, "..."]]) -> dict[str, int]:
    """Raw bytes of every tensor that rendering needs (columns, networks, tables, buffers), summed by part, so that none
    is forgotten. Parts come in the order of the tensors."""
    parts: dict[str, int] = {}
    for name, tensor in tensors.items():
        part = ".".join(name.split(".")[:PART_DEPTH])
        parts[part] = parts.get(part, 0) + raw_bytes(tensor)
    return parts
