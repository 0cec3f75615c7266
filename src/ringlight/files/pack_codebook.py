"""Rows that occur more than once are stored once, as half floats; the others as they are, as half floats too.

What vector quantisation leaves behind: rows of a codebook, and rows that were left alone (the "VecTree" of
LightGaussian, Fan et al. 2023, section 3.4, finds these). The packing asks nobody which rows are which.
"""

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from ringlight.files.pack_numbers import BYTE, Parts, part

CODE_BYTES = 2
"""Of the number of a codebook's row."""

MOST_CODES = 1 << BYTE * CODE_BYTES


def pack_codebook(values: Float[Tensor, "N *column"]) -> Parts:
    """Half floats: relative error up to 2^-11; |values| up to LARGEST_HALF. The codebook is in ascending order."""
    rows = values.half().flatten(1)
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


def unpack_codebook(parts: Parts) -> Float[Tensor, "N *column"]:
    """Inverse of :func:`pack_codebook`. Raises KeyError or ValueError for parts that it did not write."""
    book, own = part(parts, "book", torch.float16), part(parts, "own", torch.float16)
    codes, bits = part(parts, "codes", torch.uint8, 2), part(parts, "shared", torch.uint8, 1)
    count = len(codes) + len(own)
    if book.shape[1:] != own.shape[1:] or codes.shape[1] != CODE_BYTES or len(bits) != -(-count // BYTE):
        raise ValueError("codebook, codes and other rows of different shapes")
    is_shared = _from_bits(bits, count)
    places = [codes[:, place].long() << BYTE * place for place in range(CODE_BYTES)]
    numbers = torch.stack(places).sum(0)
    if int(is_shared.sum()) != len(codes) or (len(codes) and int(numbers.max()) >= len(book)):
        raise ValueError("codes of rows that the codebook has not")
    values = torch.empty(count, *own.shape[1:])
    values[is_shared], values[~is_shared] = book[numbers].float(), own.float()
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
