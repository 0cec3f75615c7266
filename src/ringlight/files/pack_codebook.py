"""Rows that occur more than once are stored once, the others as they are; as half floats, or as bytes.

What vector quantisation leaves behind: rows of a codebook, and rows that were left alone (the "VecTree" of
LightGaussian, Fan et al. 2023, section 3.4, finds these). The packing asks nobody which rows are which.
"""

import math

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from ringlight.files.pack_numbers import BYTE, LARGEST_CODE, Parts, part

CODE_BYTES = 2
"""Of the number of a codebook's row."""

MOST_CODES = 1 << BYTE * CODE_BYTES

WIDEST_ROW = 64
"""Numbers of a row: harmonics of degree 3 in three colours have 45. A file has two bytes and a bit for a row of the
codebook, so that this bounds what it becomes: 121 times its bytes, as float32."""

ZERO = 128
"""Of the signed numbers that a byte holds."""

LEAST_EXPONENT, MOST_EXPONENT = -24, 9
"""Of steps by which bytes stay half floats, and reach the largest."""


def pack_codebook(values: Float[Tensor, "N *column"]) -> Parts:
    """Half floats: relative error up to 2^-11; |values| up to LARGEST_HALF. The codebook is in ascending order. Rows
    are of WIDEST_ROW numbers at most, of others nothing comes back."""
    return _parts_of(values.half())


def unpack_codebook(parts: Parts) -> Float[Tensor, "N *column"]:
    """Inverse of :func:`pack_codebook`. Raises KeyError or ValueError for parts that it did not write."""
    return _rows_of(parts, torch.float16).float()


def pack_codebook8(values: Float[Tensor, "N *column"]) -> Parts:
    """Signed bytes, in steps of a power of two for each number of a row: the error is at most 1/127 of the number's
    largest value, half a step but beyond 127.5 steps of the largest. |values| up to LARGEST_HALF. What comes back is
    packed with the same bits again, for the largest code is 64 or more, and is a half float."""
    flat = values.flatten(1)
    largest = flat.abs().amax(0) if len(flat) else flat.new_zeros(flat.shape[1])
    exponents = (largest.double() / LARGEST_CODE).log2().ceil().clamp(LEAST_EXPONENT, MOST_EXPONENT).to(torch.int64)
    codes = (flat.double() / 2.0**exponents).round().clamp(-LARGEST_CODE, LARGEST_CODE) + ZERO
    parts = _parts_of(codes.to(torch.uint8).reshape(values.shape))
    return parts | {"exponents": (exponents + ZERO).to(torch.uint8).reshape(values.shape[1:])}


def unpack_codebook8(parts: Parts) -> Float[Tensor, "N *column"]:
    """Inverse of :func:`pack_codebook8`. Raises KeyError or ValueError for parts that it did not write."""
    codes, exponents = _rows_of(parts, torch.uint8), part(parts, "exponents", torch.uint8)
    if exponents.shape != codes.shape[1:]:
        raise ValueError("a codebook with another number of exponents than a row has numbers")
    # Exact in floats: codes of a byte times powers of two.
    steps = 2.0 ** (exponents.float() - ZERO).clamp(LEAST_EXPONENT, MOST_EXPONENT)
    return codes.float().sub_(ZERO).mul_(steps)


def _parts_of(values: Tensor) -> Parts:
    """Rows [N *column] that occur more than once, and the others."""
    rows = values.flatten(1)
    book, index, counts = torch.unique(rows, dim=0, return_inverse=True, return_counts=True)
    shared = counts > 1
    shared &= shared.cumsum(0) <= MOST_CODES
    numbers = (shared.cumsum(0) - 1)[index]
    is_shared = shared[index]
    codes = numbers[is_shared]
    places = [(codes >> BYTE * place) & 0xFF for place in range(CODE_BYTES)]
    column = values.shape[1:]
    return {
        "book": book[shared].reshape(-1, *column),
        "codes": torch.stack(places, -1).to(torch.uint8),
        "shared": _bits_from(is_shared),
        "own": rows[~is_shared].reshape(-1, *column),
    }


def _rows_of(parts: Parts, kind: torch.dtype) -> Tensor:
    """Inverse of :func:`_parts_of`."""
    book, own = part(parts, "book", kind), part(parts, "own", kind)
    codes, bits = part(parts, "codes", torch.uint8, 2), part(parts, "shared", torch.uint8, 1)
    if not (book.dim() and own.dim()) or math.prod(own.shape[1:]) > WIDEST_ROW:
        raise ValueError(f"no rows, or rows of more than {WIDEST_ROW} numbers")
    count = len(codes) + len(own)
    if book.shape[1:] != own.shape[1:] or codes.shape[1] != CODE_BYTES or len(bits) != -(-count // BYTE):
        raise ValueError("codebook, codes and other rows of different shapes")
    is_shared = _from_bits(bits, count)
    places = [codes[:, place].long() << BYTE * place for place in range(CODE_BYTES)]
    numbers = torch.stack(places).sum(0)
    if int(is_shared.sum()) != len(codes) or (len(codes) and int(numbers.max()) >= len(book)):
        raise ValueError("codes of rows that the codebook has not")
    values = torch.empty(count, *own.shape[1:], dtype=kind)
    values[is_shared], values[~is_shared] = book[numbers], own
    return values


def _bits_from(which: Bool[Tensor, "N"]) -> UInt8[Tensor, "B"]:
    """Eight to a byte, the first in the lowest bit."""
    padded = torch.zeros(-(-len(which) // BYTE) * BYTE, dtype=torch.int64)
    padded[: len(which)] = which
    return (padded.reshape(-1, BYTE) << _places()).sum(1).to(torch.uint8)


def _from_bits(bits: UInt8[Tensor, "B"], count: int) -> Bool[Tensor, "N"]:
    return ((bits.long()[:, None] >> _places()) & 1).flatten()[:count].bool()


def _places() -> Int[Tensor, "8"]:
    return torch.arange(BYTE)
