"""Texts that strangers wrote, where people read them: what could turn or hide text stands as an escape."""

import re
import unicodedata

HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode's categories of characters that show nothing themselves: controls, marks that turn the text's direction,
halves of pairs (bytes of a file name that are no text), and breaks of lines."""

BLANK = "\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0"
"""Joiners, fillers and empty Braille: letters and marks by their category, which show nothing all the same."""

UNPRINTABLE = re.compile(r"[^ -~]")


def visible(text: str) -> str:
    """``text`` with characters that show nothing as escapes: a name cannot turn the line that it stands in."""
    return UNPRINTABLE.sub(lambda found: _shown(found[0]), text)


def _shown(character: str) -> str:
    hidden = character in BLANK or unicodedata.category(character) in HIDDEN
    return ascii(character)[1:-1] if hidden else character
