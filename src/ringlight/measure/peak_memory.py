"""The most memory that this process had during a stretch of its life, above what it had before."""

import ctypes
from contextlib import suppress
from pathlib import Path

STATUS = Path("/proc/self/status")
"""Linux: resident memory now (VmRSS) and at its peak (VmHWM), kB of 1024 bytes."""

CLEAR, RESET_PEAK = Path("/proc/self/clear_refs"), "5"
"""Linux: sets the peak back to what the process has now."""

KILOBYTE = 1024


class PeakMemory:
    """Counts from where it is made. ``earlier`` is the growth of a stretch before this one, which was cut in two; None
    where there was one and its growth is not known, so that the whole is not known either."""

    def __init__(self, earlier: int | None = 0):
        self.earlier = earlier
        # glibc: free pages that were kept would hide what is asked for next
        with suppress(AttributeError, OSError, TypeError):
            ctypes.CDLL(None).malloc_trim(0)
        self._before = _bytes("VmRSS")
        try:
            CLEAR.write_text(RESET_PEAK)
            self._peak_before = 0
        except OSError:
            self._peak_before = _bytes("VmHWM") or 0

    def growth(self) -> int | None:
        """Bytes of the peak above what there was at the start. None where the system does not say, or cannot set its
        count back and the peak lies before the start."""
        before, peak = self._before, _bytes("VmHWM")
        if self.earlier is None or before is None or peak is None or peak <= self._peak_before:
            return self.earlier or None
        return max(peak - before, self.earlier)


def _bytes(key: str) -> int | None:
    try:
        lines = STATUS.read_text().splitlines()
        return next(int(line.split()[1]) * KILOBYTE for line in lines if line.startswith(f"{key}:"))
    except (OSError, StopIteration, ValueError, IndexError):
        return None
