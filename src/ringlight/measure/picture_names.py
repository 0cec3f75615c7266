"""Where a run keeps the pictures of its test views: written when a run is measured, read when runs are compared."""

import re
from pathlib import Path

RENDERS = Path("images", "test")
"""Below the run folder: test views as the model shows them, 8-bit PNG."""
TRUTHS = Path("images", "truth")
"""The same views as photographed, so that runs can be compared without the data set."""

FORBIDDEN = re.compile(r'[%/\\:*?"<>|\x00-\x1f]')
"""Separators, what Windows refuses in names, and the percent sign that stands for them."""


def picture_name(view: str) -> str:
    """The file name for a view; forbidden characters are percent-encoded, so that no two views share a file."""
    return FORBIDDEN.sub(lambda match: f"%{ord(match.group()):02X}", view) + ".png"
