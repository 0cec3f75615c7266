"""How much memory this process may have: the machine's, or what a container or a limit leaves of it."""

import contextlib
import os
from pathlib import Path

UNKNOWN = 8 << 30
"""Bytes assumed where the system does not say."""

CGROUPS, OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def machine_memory() -> int:
    """Bytes of memory, used or not: the same number on every day of the same machine."""
    known = [_physical(), *_container_limits(), *_own_limits()]
    return min((size for size in known if size > 0), default=UNKNOWN)


def _physical() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not on Windows
        return 0


def _container_limits() -> list[int]:
    """What version 1 and 2 of Linux's control groups allow; a group without a limit says "max" or a huge number."""
    limits = []
    for folder, name in ((CGROUPS, "memory.max"), (CGROUPS / "memory", "memory.limit_in_bytes")):
        for group in _own_groups():
            with contextlib.suppress(OSError, ValueError):
                limits.append(int((folder / group / name).read_text()))
    return limits


def _own_groups() -> list[Path]:
    """The groups that this process is in, and those above them, whose limits hold for it too; inside a container all
    that can be seen is often the top."""
    groups = {Path()}
    with contextlib.suppress(OSError):
        for line in OWN_GROUPS.read_text().splitlines():
            path = Path(line.split(":", 2)[-1].lstrip("/"))
            groups.update((path, *path.parents))
    return sorted(groups)


def _own_limits() -> list[int]:
    try:
        import resource
    except ImportError:  # Windows has none
        return []
    return [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]  # -1: no limit
