"""Bytes as text that an HTML parser leaves as it is: an eighth more than the bytes, where base64 takes a third more.

Seven bits make a character, in UTF-8. Three would not survive a parser: NUL, the carriage return, and "<", with which
an end tag begins. In their place stands one character of two bytes that holds which of the three it was, and the next
seven bits. The page's ``text_bytes.js`` reads it.
"""

import numpy as np

REFUSED = (0, 13, 60)
"""NUL, carriage return, "<"."""

PAIRS = 256
"""The first character of two bytes that is taken; those below 160 are control characters that some tools change."""

GROUP = 7


def text_from_bytes(data: bytes) -> str:
    """The characters, about 8/7 as many as bytes; the last group is filled up with zeros."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    groups = np.packbits(np.pad(bits, (0, -len(bits) % GROUP)).reshape(-1, GROUP), axis=1)[:, 0] >> 1
    text: list[str] = []
    begin = 0
    for at in np.flatnonzero(np.isin(groups, REFUSED)).tolist():
        if at < begin:
            continue  # it went into the pair before
        following = int(groups[at + 1]) if at + 1 < len(groups) else 0
        pair = PAIRS + (REFUSED.index(int(groups[at])) << GROUP | following)
        text += (groups[begin:at].tobytes().decode("ascii"), chr(pair))
        begin = at + 2
    text.append(groups[begin:].tobytes().decode("ascii"))
    return "".join(text)


def bytes_from_text(text: str, length: int) -> bytes:
    """Inverse of :func:`text_from_bytes`; ``length`` is that of the bytes. Raises ValueError for other text."""
    groups: list[int] = []
    for character in text:
        code = ord(character)
        if code < 1 << GROUP and code not in REFUSED:
            groups.append(code)
            continue
        which, following = divmod(code - PAIRS, 1 << GROUP)
        if not 0 <= which < len(REFUSED):
            raise ValueError(f"the character {character!r} holds no bytes")
        groups += (REFUSED[which], following)
    bits = np.unpackbits(np.array(groups, np.uint8)[:, None], axis=1)[:, 1:].reshape(-1)
    data = np.packbits(bits[: 8 * length]).tobytes()
    if len(data) != length:
        raise ValueError(f"the text holds {len(data)} bytes, not {length}")
    return data
