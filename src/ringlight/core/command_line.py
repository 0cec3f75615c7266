"""Commands that a sentence offers to copy, quoted for the shell: folders have blanks, and worse."""

import os
import shlex
from pathlib import Path

QUOTE, BACKSLASH = ord("'"), ord("\\")
VISIBLE = range(0x20, 0x7F)
"""ASCII that any terminal shows as it is."""


def command(*words: str | Path) -> str:
    """``ringlight`` and the words, to be pasted into a shell as they are: ``command("eval", path)``.

    Control characters, and bytes of names that are no text, are escapes in bash's ``$'...'``.
    """
    return " ".join(["ringlight", *(_quoted(str(word)) for word in words)])


def _quoted(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    return "$'" + "".join(_escaped(byte) for byte in os.fsencode(word)) + "'"


def _escaped(byte: int) -> str:
    if byte in (QUOTE, BACKSLASH):
        return f"\\{chr(byte)}"
    return chr(byte) if byte in VISIBLE else f"\\x{byte:02x}"
