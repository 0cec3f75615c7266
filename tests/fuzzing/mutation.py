"""Damaged versions of a file: what transfers, disks and strangers do to it. The same seed gives the same bytes."""

import json
import random
import re
import struct
from typing import Any

MOST_EDITS = 4

WHOLES = [0, 1, 2, 127, 128, 255, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**53, 2**63 - 1, 2**63, 2**64 - 1]
REALS = [0.0, -0.0, 1e-320, 1e-30, 1.0, 1e30, 1e300, float("inf"), -float("inf"), float("nan")]
WORDS = [
    b"0", b"-1", b"1", b"1e999", b"-1e999", b"NaN", b"Infinity", b"-Infinity", b"nan", b"99999999999999999999",
    b"1e308", b"4294967296", b"null", b"true", b'""', b"[]", b"{}", b"[[[[", b'"../../../etc/passwd"', b'"\\u0000"',
    b"\xff\xfe", b"\n",
]  # fmt: skip
VALUES: list[Any] = [
    None, True, False, 0, -1, 1, 0.5, 2**31, 2**53, 2**63, 2**64, 10**40, 1e30, 1e300, float("nan"), float("inf"), "",
    "x", "0", "../x", "/etc/passwd", "a\0b", "\ud800", "nan", [], {}, [[]], [0] * 100, {"": 0},
]  # fmt: skip
LARGEST_TREE = 100_000
"""Bytes of JSON that are parsed and written again for one edit."""
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def mutated(content: bytes, others: list[bytes], draw: random.Random) -> bytes:
    """``content`` after one to :data:`MOST_EDITS` edits; ``others`` lend pieces."""
    data = bytearray(content)
    for _ in range(draw.choice([1, 1, 1, 2, 3, MOST_EDITS])):
        draw.choice(EDITS)(data, others, draw)
    return bytes(data)


def _place(data: bytearray, draw: random.Random) -> int:
    # Headers decide what the rest means: half of the edits go there.
    return draw.randrange(min(len(data), 256) if draw.random() < 0.5 else len(data)) if data else 0


def flip(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    if data:
        data[_place(data, draw)] ^= 1 << draw.randrange(8)


def overwrite(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    if data:
        data[_place(data, draw)] = draw.choice([0, 1, 0x7F, 0x80, 0xFF, draw.randrange(256)])


def cut(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    del data[_place(data, draw) :]


def remove(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    begin = _place(data, draw)
    del data[begin : begin + draw.randint(1, 40)]


def repeat(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    begin = _place(data, draw)
    piece = bytes(data[begin : begin + draw.randint(1, 64)])
    data[begin:begin] = piece * draw.choice([1, 2, 50])


def whole_number(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    value, width = draw.choice(WHOLES), draw.choice([1, 2, 4, 8])
    _set(data, (value % (1 << 8 * width)).to_bytes(width, draw.choice(["little", "big"])), draw)  # type: ignore[arg-type]


def real_number(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    value = draw.choice(REALS)
    single = draw.random() < 0.5 and not 1e38 < abs(value) < float("inf")
    _set(data, struct.pack("<f" if single else "<d", value), draw)


def _set(data: bytearray, value: bytes, draw: random.Random) -> None:
    begin = _place(data, draw)
    data[begin : begin + len(value)] = value


def word(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    """Text: a number becomes another word."""
    numbers = list(NUMBER.finditer(bytes(data[:4096])))
    if not numbers:
        return
    begin, end = draw.choice(numbers).span()
    data[begin:end] = draw.choice(WORDS)


def digits(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    """Text: a number gets more digits, or is counted one up."""
    numbers = list(NUMBER.finditer(bytes(data[:4096])))
    if not numbers:
        return
    begin, end = draw.choice(numbers).span()
    old = bytes(data[begin:end])
    more = old.isdigit() and len(old) < 100 and draw.random() < 0.5
    data[begin:end] = b"%d" % (int(old) + 1) if more else old * draw.choice([2, 30])


def tree(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    """JSON, also at the head of a safetensors file: one value becomes another, and the file stays well formed."""
    begin, end = 0, len(data)
    if data[8:9] == b"{":
        begin, end = 8, 8 + int.from_bytes(data[:8], "little")
    if data[begin : begin + 1] != b"{" or end - begin > LARGEST_TREE:
        return
    try:
        encoded = json.dumps(_changed(json.loads(bytes(data[begin:end])), draw), separators=(",", ":")).encode()
    except (ValueError, RecursionError):
        return
    data[begin:end] = encoded
    if begin:
        data[:begin] = len(encoded).to_bytes(8, "little")


def _changed(value: Any, draw: random.Random) -> Any:
    """``value`` with one place below it, or itself, replaced; texts that are JSON are entered too."""
    if isinstance(value, str) and value[:1] in ("{", "[") and draw.random() < 0.9:
        return json.dumps(_changed(json.loads(value), draw), separators=(",", ":"))
    if not isinstance(value, dict | list) or not value or draw.random() < 0.1:
        return draw.choice(VALUES)
    places = list(value) if isinstance(value, dict) else list(range(len(value)))
    place, kind = draw.choice(places), draw.random()
    if kind < 0.1:
        del value[place]
    elif kind < 0.2:
        value[place] = value[draw.choice(places)]
    elif kind < 0.25 and isinstance(value, dict):
        value[draw.choice(["", "x", place + "x"])] = value.pop(place)
    elif kind < 0.3 and isinstance(value, list):
        value.extend([value[place]] * draw.choice([1, 50]))
    else:
        value[place] = _changed(value[place], draw)
    return value


def splice(data: bytearray, others: list[bytes], draw: random.Random) -> None:
    other = draw.choice(others)
    data[_place(data, draw) :] = other[draw.randrange(len(other) or 1) :]


EDITS = (flip, flip, overwrite, cut, remove, repeat, whole_number, real_number, word, digits, splice, tree, tree, tree)
