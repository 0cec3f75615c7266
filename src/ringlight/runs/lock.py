"""One process at a time trains or measures a run: a lock on its folder, released however that process ends."""

import os
from contextlib import suppress
from pathlib import Path

from ringlight.errors import RunError

try:
    import fcntl
except ImportError:  # Windows: nobody is locked out there
    fcntl = None  # type: ignore[assignment]

LOCKS = Path("/proc/locks")
"""Where Linux says who holds which."""


class RunLock:
    """Held from its making to its release, or to the end of the process, SIGKILL included; leaves no file behind.

    Raises RunError that names the process which holds it. Disks that know no locks (some of networks) lock nobody out.
    """

    def __init__(self, folder: Path, doing: str = "is training or measuring this run"):
        self._handle: int | None = None
        if fcntl is None:
            return
        self._handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            remedy = "wait until that has ended, or stop it"
            raise RunError(f"{folder}: {holder(folder)} {doing}; {remedy}") from None
        except OSError:
            self.release()

    def release(self) -> None:
        """Let others have it."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def __del__(self) -> None:
        self.release()


def holder(folder: Path) -> str:
    """The process that holds the lock, where the system tells; a container is told of its own alone."""
    status = folder.stat()
    place = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    with suppress(OSError):
        for line in LOCKS.read_text().splitlines():
            words = line.split()
            if place in words and "FLOCK" in words and (number := words[words.index(place) - 1]) != "0":
                return f"process {number}"
    return "another process"
