"""Texts that strangers wrote, where people read them: what could turn or hide text stands as an escape."""

import re
import unicodedata

HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode's categories of characters that show nothing themselves: controls, marks that turn the text's direction,
halves of pairs (bytes of a file name that are no text), and breaks of lines."""

UNPRINTABLE = re.compile(r"[^ -~]")


def visible(text: str) -> str:
    """``text`` with characters that show nothing as escapes: a name cannot turn the line that it stands in."""
    return UNPRINTABLE.sub(lambda found: _shown(found[0]), text)


def _shown(character: str) -> str:
    return ascii(character)[1:-1] if unicodedata.category(character) in HIDDEN else character
