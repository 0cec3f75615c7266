"""Whether matrices are multiplied as bfloat16."""

import torch

from ringlight import _kernels

HALVES = True
"""Whether products of the network's layers and of a tensor train's cores may be of bfloat16. What that changes:
docs/methods/putt.md."""

FASTER_ON = ("avx512_bf16", "avx512_amx")
"""Kernels' names of processors that multiply these faster."""

ROWS = 256
"""Of matrices of bfloat16 torch takes multiples, and SIZES an octave: it compiles a program for every count of rows it
meets, and keeps a thousand of up to a megabyte each, which lie between a step's arrays."""

SIZES = 8
"""Zeros after the rows are an eighth of them at most, and a sixteenth on average."""


def multiplies_halves() -> bool:
    """As this processor does it."""
    return HALVES and _kernels.isa() in FASTER_ON


def even_rows(count: int, dtype: torch.dtype) -> int:
    """``count``, or the next number of rows for which there are few programs."""
    if dtype != torch.bfloat16:
        return count
    multiple = max(ROWS, (1 << max(count - 1, 0).bit_length()) // (2 * SIZES))
    return -(-count // multiple) * multiple
