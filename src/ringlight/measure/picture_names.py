"""Where a run keeps the pictures of its test views: written when a run is measured, read when runs are compared."""

import re
from pathlib import Path

RENDERS = Path("images", "test")
"""Below the run folder: test views as the model shows them, 8-bit PNG."""
TRUTHS = Path("images", "truth")
"""The same views as photographed, so that runs can be compared without the data set."""

FOLDER_MARK = "__"
"""Stands for a slash."""
ESCAPED = re.compile(r'[%\\:*?"<>|\x00-\x1f]|_(?=[_/])|(?<=[_/])_')
"""What Windows refuses in names, the percent sign that stands for it, and underscores that could read as a slash."""


def picture_name(view: str) -> str:
    """The file name for a view: "test/r_0.png" becomes "test__r_0.png", what cannot be in a name is percent-encoded.

    No two views share a file, unless their names differ in nothing but a ".png" at the end.
    """
    name = folder_name(view)
    return name if name.endswith(".png") else f"{name}.png"


def folder_name(label: str) -> str:
    """The same without an ending, for a folder; no two labels share one."""
    return ESCAPED.sub(lambda match: f"%{ord(match.group()):02X}", label).replace("/", FOLDER_MARK)
