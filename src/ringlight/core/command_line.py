"""Commands that a sentence offers to copy, quoted for the shell: folders have blanks, and worse."""

import shlex
from pathlib import Path


def command(*words: str | Path) -> str:
    """``ringlight`` and the words, to be pasted into a shell as they are: ``command("eval", path)``."""
    return shlex.join(["ringlight", *map(str, words)])
