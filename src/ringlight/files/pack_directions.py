"""Directions and rotations in fewer bytes: octahedral coordinates of 2 x 10 bit, three components of a quaternion.

Parts and errors are as in ``pack_numbers``. Lengths are not kept: what is packed here is normalized where it is used.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.directions import directions_from_octahedral, normalize, octahedral_from_directions
from ringlight.files.pack_numbers import Parts, part

OCTAHEDRAL_STEPS = 1022
"""Even, so that the axes and the square's centre lie on codes; 1022 is the largest that 10 bits hold. With 2 x 8 bit a
mirror's reflections lose some 2 dB."""

QUATERNION_STEPS = 1022
"""The same for a quaternion's components, so that no rotation is exactly none."""

TURN_STEPS = 254
"""Even, and what 8 bits hold."""

SMALLEST_THREE = 0.5**0.5
"""The three smaller components of a unit quaternion lie within this."""

MOST_NUDGES, NUDGED = 4, SMALLEST_THREE / QUATERNION_STEPS / 2
"""A component within a quarter of a step of the largest is moved by one, which is enough but for three equal ones."""


def pack_directions(vectors: Float[Tensor, "N 3"]) -> Parts:
    """2.5 bytes each, at most a quarter of a degree off: low bytes of the two codes, and both high pairs of bits in a
    nibble."""
    square = octahedral_from_directions(normalize(vectors.double()))
    codes = ((square + 1) * (OCTAHEDRAL_STEPS / 2)).round().long().clamp(0, OCTAHEDRAL_STEPS)
    nibbles = (codes[:, 0] >> 8) | (codes[:, 1] >> 8) << 2
    if len(nibbles) % 2:
        nibbles = torch.cat([nibbles, nibbles.new_zeros(1)])
    high = nibbles[0::2] | nibbles[1::2] << 4
    return {"low": (codes & 0xFF).to(torch.uint8), "high": high.to(torch.uint8)}


def unpack_directions(parts: Parts) -> Float[Tensor, "N 3"]:
    """Inverse of :func:`pack_directions`, as unit vectors."""
    low, high = part(parts, "low", torch.uint8, 2).long(), part(parts, "high", torch.uint8, 1).long()
    if low.shape[1] != 2 or len(high) != (len(low) + 1) // 2:
        raise ValueError("low and high bits of different numbers of rows")
    nibbles = torch.stack([high & 0xF, high >> 4], -1).flatten()[: len(low)]
    codes = torch.stack([low[:, 0] | (nibbles & 3) << 8, low[:, 1] | (nibbles >> 2) << 8], -1)
    return directions_from_octahedral(codes.double() * (2 / OCTAHEDRAL_STEPS) - 1).float()


def pack_quaternions(quats: Float[Tensor, "N 4"]) -> Parts:
    """Four bytes each, at most 0.5 degrees off: which component is largest (2 bit), and the others in 10 bit each.
    What comes back is packed with the same bits again."""
    length = quats.double().norm(dim=-1, keepdim=True)
    unit = quats.double() / torch.where(length > 0, length, 1)
    largest = unit.abs().argmax(-1)
    # A quaternion and its negative are one rotation: the component that is left out is made the positive one.
    sign = torch.where(unit.gather(1, largest[:, None]) < 0, -1.0, 1.0)
    others = (unit * sign).gather(1, _others(largest))
    codes = ((others / SMALLEST_THREE + 1) * (QUATERNION_STEPS / 2)).round().long().clamp(0, QUATERNION_STEPS)
    codes = _below_the_largest(codes)
    word = largest << 30 | codes[:, 0] << 20 | codes[:, 1] << 10 | codes[:, 2]
    return {"words": torch.stack([(word >> shift) & 0xFF for shift in (0, 8, 16, 24)], -1).to(torch.uint8)}


def unpack_quaternions(parts: Parts) -> Float[Tensor, "N 4"]:
    """Inverse of :func:`pack_quaternions`, as unit quaternions wxyz."""
    words = part(parts, "words", torch.uint8, 2).long()
    if words.shape[1] != 4:
        raise ValueError("quaternions of another size than four bytes")
    word = words[:, 0] | words[:, 1] << 8 | words[:, 2] << 16 | words[:, 3] << 24
    codes = torch.stack([(word >> 20) & 0x3FF, (word >> 10) & 0x3FF, word & 0x3FF], -1)
    others, left_out = _components(codes)
    largest = word >> 30
    unit = torch.zeros(len(word), 4, dtype=torch.float64)
    unit.scatter_(1, _others(largest), others).scatter_(1, largest[:, None], left_out)
    return (unit / unit.norm(dim=-1, keepdim=True)).float()


def _components(codes: Int[Tensor, "N 3"]) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 1"]]:
    """What three codes stand for, and the component that is left out."""
    others = (codes.double() * (2 / QUATERNION_STEPS) - 1) * SMALLEST_THREE
    return others, (1 - others.square().sum(-1, keepdim=True)).clamp_min(0).sqrt()


def _below_the_largest(codes: Int[Tensor, "N 3"]) -> Int[Tensor, "N 3"]:
    """Codes of components that rounding has made as large as the one that is left out, a step nearer to zero: otherwise
    another component would be left out the next time, perhaps with the other sign, and rounded anew."""
    for _ in range(MOST_NUDGES):
        others, left_out = _components(codes)
        nudged = others.abs() > left_out - NUDGED
        if not bool(nudged.any()):
            break
        codes = torch.where(nudged, codes - others.sign().long(), codes)
    return codes


def _others(largest: Int[Tensor, "N"]) -> Int[Tensor, "N 3"]:
    """The three components besides the largest, ascending."""
    table = torch.tensor([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    return table[largest]


def pack_turns(quats: Float[Tensor, "N 4"]) -> Parts:
    """Three bytes each, at most 1.2 degrees off: an ellipsoid's axes have no sign, so that half a turn about one of
    them changes nothing. Of the four quaternions which show the same that is taken whose w is largest, and x, y, z are
    kept in 8 bit each. What comes back is another rotation of the same ellipsoid: not for axes that point somewhere.
    """
    length = quats.double().norm(dim=-1, keepdim=True)
    w, x, y, z = torch.where(length > 0, quats / length, quats.new_tensor([1.0, 0, 0, 0])).double().unbind(-1)
    half_turned = [torch.stack(turn, -1) for turn in ((w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w))]
    same = torch.stack(half_turned, 1)
    chosen = same[:, :, 0].abs().argmax(1)
    turn = same.gather(1, chosen[:, None, None].expand(-1, 1, 4))[:, 0]
    axis = turn[:, 1:] * torch.where(turn[:, :1] < 0, -1.0, 1.0)
    codes = ((axis / SMALLEST_THREE + 1) * (TURN_STEPS / 2)).round().clamp(0, TURN_STEPS)
    return {"codes": codes.to(torch.uint8)}


def unpack_turns(parts: Parts) -> Float[Tensor, "N 4"]:
    """Unit quaternions wxyz of the ellipsoids of :func:`pack_turns`."""
    codes = part(parts, "codes", torch.uint8, 2).double()
    if codes.shape[1] != 3:
        raise ValueError("turns of another size than three bytes")
    axis = (codes * (2 / TURN_STEPS) - 1) * SMALLEST_THREE
    turn = torch.cat([(1 - axis.square().sum(-1, keepdim=True)).clamp_min(0).sqrt(), axis], -1)
    return (turn / turn.norm(dim=-1, keepdim=True)).float()
