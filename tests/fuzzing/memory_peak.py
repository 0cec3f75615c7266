"""The most memory that a file took while it was read, whoever asked for it: Python, torch, a library of C."""

import ctypes
import resource
import sys
from contextlib import suppress
from pathlib import Path

CLEAR, RESET_PEAK = Path("/proc/self/clear_refs"), "5"
"""Linux: sets the process's peak back to what it has now."""

UNIT = 1024 if sys.platform.startswith("linux") else 1
"""Bytes in one of what ``ru_maxrss`` counts."""


class MemoryPeak:
    """Of resident memory. Where the system cannot set it back, only a peak above all earlier ones is seen."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Count from what the process has now."""
        with suppress(AttributeError):  # glibc: what is free but not given back would hide what is asked for next
            ctypes.CDLL(None).malloc_trim(0)
        with suppress(OSError):
            CLEAR.write_text(RESET_PEAK)
        self._base = _peak()

    @property
    def growth(self) -> int:
        """Bytes above what the process had at the last reset."""
        return _peak() - self._base


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT
