"""Whether photographs are still those with which a run began, told without reading them whole."""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from ringlight.core.scene import View
from ringlight.core.stages import counted as each_told
from ringlight.core.words import counted

PIECE = 65_536
"""Bytes that are read at the beginning, in the middle and at the end. A change elsewhere that leaves a file's size as
it was is not seen: of compressed pictures there is none by chance, of large uncompressed ones there may be."""

MARK_BYTES = 4
"""Of a photograph's mark: a change passes for none once in four thousand million."""

MOST_NAMED = 3
"""Photographs that a sentence names."""

UNKNOWN = "-"
"""The mark of what lies in no file, or in one that cannot be read."""


def mark_of(*paths: Path) -> str:
    """Sizes and pieces of the files, hashed."""
    summed = hashlib.blake2b(digest_size=MARK_BYTES)
    try:
        for path in paths:
            with path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                summed.update(b"%d " % size)
                for place in (0, size // 2, max(size - PIECE, 0)):
                    file.seek(place)
                    summed.update(file.read(PIECE))
    except OSError:  # whoever decodes it says so
        return UNKNOWN
    return summed.hexdigest()


def marks_of(views: Sequence[View]) -> str:
    """The marks of all photographs in the order of ``views``, with blanks between."""
    return " ".join(view.mark() if view.mark else UNKNOWN for view in each_told("looking at photographs", views))


def change_since(before: str, now: str, views: Sequence[View]) -> tuple[str, ...]:
    """A sentence on photographs that have other marks ``now`` than ``before``; none where they are the same, or not as
    many."""
    marks, then = now.split(), before.split()
    if len(marks) != len(then):
        return ()
    changed = [v.name for v, a, b in zip(views, marks, then, strict=True) if UNKNOWN not in (a, b) and a != b]
    if not changed:
        return ()
    some = ", ".join(changed[:MOST_NAMED]) + (", ..." if len(changed) > MOST_NAMED else "")
    masks = "its mask" if len(changed) == 1 else "their masks"
    return (
        f"{counted(len(changed), 'training photograph')} ({some}) or {masks} changed since the run was saved, and "
        "it goes on with what is there now; for a run of the same photographs throughout start again with --out NEW",
    )
