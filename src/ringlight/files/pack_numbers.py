"""Numbers in fewer bytes: half floats, rows of bytes with a scale, fixed point over a column's range, shares in 8 bit.

A packing turns a float32 tensor into *parts*, small named tensors, and back. What comes back has the shape of what went
in; the shape is that of the codes, so that a file cannot announce more memory than a few times its bytes. Rows of a
codebook (``pack_codebook.py``) may take more, and are bounded by their width. Unpacking parts that no packing wrote
raises KeyError or ValueError.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

Parts = dict[str, Tensor]

LARGEST_HALF = 65_504.0
"""Beyond it a half float is infinite."""

LARGEST_CODE = 127
"""Of a signed byte; -128 is left out, so that codes are symmetric."""

SHORTEST_ROW = 32
"""Values that share a scale, at least: the scale then costs an eighth of the codes, or less."""

DARKEST = 0.25 / 255
"""What the codes 0 and 255 of a share stand for, from either end: their own logits would be infinite, this still rounds
to black or white."""

BYTE = 8

MOST_BYTES = 4
"""Of a fixed-point code: more than a float32 can tell apart."""


def part(parts: Parts, name: str, dtype: torch.dtype, dimensions: int | None = None) -> Tensor:
    """The part called ``name``. Raises KeyError if it is missing, ValueError for another type or rank."""
    tensor = parts[name]
    if tensor.dtype != dtype or (dimensions is not None and tensor.dim() != dimensions):
        raise ValueError(f"part {name!r} has another type or shape than its packing writes")
    return tensor


def pack_half(values: Float[Tensor, "*shape"]) -> Parts:
    """Half floats: relative error up to 2^-11; |values| up to LARGEST_HALF."""
    return {"half": values.half()}


def unpack_half(parts: Parts) -> Float[Tensor, "*shape"]:
    """Inverse of :func:`pack_half`."""
    return part(parts, "half", torch.float16).float()


def pack_rows(values: Float[Tensor, "*shape"]) -> Parts:
    """Signed bytes, one scale for each row: the error is at most half a scale, 1/254 of the row's largest value.

    A row is the shortest tail of dimensions with SHORTEST_ROW values or more: the weights of one output or of one
    input, the R x R matrix of one channel, one node of a table.
    """
    rows = values.shape[: _row_dimensions(values.shape)]
    flat = values.reshape(*rows, -1)
    scale = flat.abs().amax(-1) / LARGEST_CODE if flat.numel() else flat.new_zeros(rows)
    codes = (flat / scale.clamp_min(torch.finfo(torch.float32).tiny)[..., None]).round()
    codes = codes.clamp(-LARGEST_CODE, LARGEST_CODE).to(torch.int8)
    return {"codes": codes.reshape(values.shape), "scale": scale}


def unpack_rows(parts: Parts) -> Float[Tensor, "*shape"]:
    """Inverse of :func:`pack_rows`."""
    codes, scale = part(parts, "codes", torch.int8), part(parts, "scale", torch.float32)
    if scale.dim() > codes.dim() or codes.shape[: scale.dim()] != scale.shape:
        raise ValueError("scales and codes of different shapes")
    return codes.float() * scale.reshape(*scale.shape, *(1 for _ in codes.shape[scale.dim() :]))


def _row_dimensions(shape: torch.Size) -> int:
    """Leading dimensions that number the rows."""
    return next((count for count in range(len(shape) - 1, 0, -1) if math.prod(shape[count:]) >= SHORTEST_ROW), 0)


def pack_fixed(values: Float[Tensor, "N *column"], width: int) -> Parts:
    """Whole numbers of ``width`` bytes, evenly over each column's own range: an error of half a step at most.

    The code of a value is its bytes along a last dimension, the lowest first.
    """
    codes, low, step = _over_range(values, BYTE * width)
    places = [(codes >> BYTE * place) & 0xFF for place in range(width)]
    return {"codes": torch.stack(places, -1).to(torch.uint8), "low": low, "step": step}


def pack_in_steps(values: Float[Tensor, "N K"], step: Float[Tensor, "K"]) -> Parts:
    """Parts of :func:`pack_fixed` whose columns have these steps, of one byte where all codes fit, else of two.

    Zero stands in the middle of the lowest byte's range, so that deflating finds small values alike. Raises ValueError
    where two bytes are too few.
    """
    codes = (values.double() / step).round()
    middle = 1 << BYTE - 1
    furthest = float(codes.abs().amax()) if codes.numel() else 0.0
    width = 1 if furthest < middle else 2
    middle += (width - 1) * (1 << BYTE * width - 1)
    if not furthest < (1 << BYTE * width) - middle:
        raise ValueError("a value is too many steps from zero")
    whole = codes.long() + middle
    places = [(whole >> BYTE * place) & 0xFF for place in range(width)]
    return {"codes": torch.stack(places, -1).to(torch.uint8), "low": -middle * step, "step": step}


def unpack_fixed(parts: Parts) -> Float[Tensor, "N *column"]:
    """Inverse of :func:`pack_fixed`."""
    codes = part(parts, "codes", torch.uint8)
    low, step = part(parts, "low", torch.float64), part(parts, "step", torch.float64)
    width = codes.shape[-1] if codes.dim() >= 2 else 0
    if not 1 <= width <= MOST_BYTES or not low.shape == step.shape == codes.shape[1:-1]:
        raise ValueError("codes, low ends and steps of different shapes")
    whole = sum(codes[..., place].double() * 2.0 ** (BYTE * place) for place in range(width))
    return (low + step * whole).float()


def pack_fine(values: Float[Tensor, "N *column"], bits: int) -> Parts:
    """Whole numbers of 8 and ``bits`` more bits, evenly over each column's own range: an error of half a step at most.

    ``codes`` are the upper bytes. The bits below, 2 or 4 so that none lie in two bytes, fill the bytes of ``fine`` one
    after the other, from the lowest on.
    """
    whole, low, step = _over_range(values, BYTE + bits)
    below, each = (whole & ((1 << bits) - 1)).flatten(), BYTE // bits
    below = torch.nn.functional.pad(below, (0, -len(below) % each)).reshape(-1, each)
    fine = sum(below[:, place] << bits * place for place in range(each))
    codes = (whole >> bits).to(torch.uint8)
    return {"codes": codes, "fine": torch.as_tensor(fine).to(torch.uint8), "low": low, "step": step}


def unpack_fine(parts: Parts, bits: int) -> Float[Tensor, "N *column"]:
    """Inverse of :func:`pack_fine`."""
    codes, fine = part(parts, "codes", torch.uint8), part(parts, "fine", torch.uint8, 1)
    low, step = part(parts, "low", torch.float64), part(parts, "step", torch.float64)
    each = BYTE // bits
    if not codes.dim() or not low.shape == step.shape == codes.shape[1:] or len(fine) != -(-codes.numel() // each):
        raise ValueError("codes, bits below them, low ends and steps of different shapes")
    below = torch.stack([(fine >> bits * place) & ((1 << bits) - 1) for place in range(each)], -1).flatten()
    whole = codes.double() * (1 << bits) + below[: codes.numel()].reshape(codes.shape)
    return (low + step * whole).float()


def _over_range(values: Float[Tensor, "N *column"], bits: int) -> tuple[Tensor, Tensor, Tensor]:
    """Whole numbers of so many bits, and of each column what the lowest stands for and the step, float64."""
    wide = values.double()
    low = wide.amin(0) if len(wide) else wide.new_zeros(values.shape[1:])
    high = wide.amax(0) if len(wide) else low
    step = (high - low) / ((1 << bits) - 1)
    return ((wide - low) / torch.where(step > 0, step, 1)).round().long(), low, step


def pack_share(logits: Float[Tensor, "*shape"]) -> Parts:
    """The sigmoid in 8 bit, as pictures hold colours: an error of half a step of 1/255 in the sigmoid."""
    return {"share": (logits.double().sigmoid() * 255).round().to(torch.uint8)}


def unpack_share(parts: Parts) -> Float[Tensor, "*shape"]:
    """Inverse of :func:`pack_share`, as logits."""
    share = part(parts, "share", torch.uint8).double() / 255
    return share.clamp(DARKEST, 1 - DARKEST).logit().float()
