"""What must hold whenever a command refuses: one sentence, the right exit code, nothing changed."""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

from command import Outcome

QUIET = ("--quiet", "--lpips")
SHORT = ("--steps", "2", "--initial-points", "100", *QUIET)

PROGRESS = re.compile(r"reading |[a-z ']+: \d+/\d+$|[\w-]+ on .+ training and |  \S")
"""What a log may say before: what was under way, and the scene's lines."""

Damage = Callable[[Path], object]


def snapshot(*roots: Path) -> dict[str, str]:
    """Hash of every file below the roots."""
    files = [file for root in roots for file in ([root] if root.is_file() else sorted(root.rglob("*")))]
    return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files if file.is_file()}


def refused(outcome: Outcome, code: int, *names: object) -> str:
    """Exactly one sentence that mentions ``names``; returns it."""
    assert outcome.code == code, outcome
    assert not outcome.out
    assert "Traceback" not in outcome.err
    lines = outcome.err.splitlines()
    while lines and PROGRESS.match(lines[0]):
        del lines[0]
    assert len(lines) == 1, outcome.err
    assert lines[0].startswith("ringlight"), lines[0]
    for name in names:
        assert str(name) in lines[0], f"{name} is not in: {lines[0]}"
    assert re.search(r"[;,:] ", lines[0]), f"no remedy in: {lines[0]}"
    return lines[0]
