"""Text on pictures: Pillow's own font knows ASCII alone, and lines end where the picture does."""

import unicodedata

from PIL import ImageFont


def drawable(text: str) -> str:
    """``text`` in letters that the font has: accents are left out, "№" is "No", and all else is shown as an escape."""
    return "".join(map(_letter, text))


def wrapped(text: str, size: int, width: int) -> list[str]:
    """Lines of at most ``width`` pixels, broken between words, in letters of ``size``; a longer word has its own."""
    font, lines = ImageFont.load_default(size), [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def cut(text: str, size: int, width: int) -> str:
    """One drawable line of at most ``width`` pixels, in letters of ``size``."""
    font, line = ImageFont.load_default(size), drawable(text)
    while len(line) > 1 and font.getlength(line) > width:
        line = f"{line.removesuffix('..')[:-1]}.."
    return line


def _letter(letter: str) -> str:
    plain = unicodedata.normalize("NFKD", letter)
    plain = "".join(part for part in plain if not unicodedata.combining(part))
    return plain if plain and plain.isascii() and plain.isprintable() else ascii(letter)[1:-1]
