"""Texts that strangers wrote, as Markdown that shows them as they are, and lines of tables."""

import re
from collections.abc import Sequence

from ringlight.core.visible_text import visible

INLINE = re.compile(r"[\\`*\[\]<>&~#$]|(?<![^\W_])_|_(?![^\W_])|:(?=//)|(?<=www)\.")
"""What could style text, or make a link, a picture, a formula or a tag of it. An underscore in a word does nothing, and
names of scenes are full of them. What stays: GitHub makes links of addresses of mail, and of users after an @."""

BLOCK = re.compile(r"^(\d{1,9})(?=[.)](?:\s|$))|^(?=[-+=])")
"""Where a line could begin a list or a heading."""


def markdown_text(text: str) -> str:
    """``text`` for the midst of a line, or for a cell of :func:`markdown_row`; what turns or hides text is an escape
    that can be read."""
    return INLINE.sub(r"\\\g<0>", visible(text))


def markdown_line(text: str) -> str:
    """``text`` for a line of its own."""
    return BLOCK.sub(r"\1\\", markdown_text(text.strip()))


def markdown_row(cells: Sequence[str]) -> str:
    """A line of a GitHub table, of cells that are Markdown already."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
