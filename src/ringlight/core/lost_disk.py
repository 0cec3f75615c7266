"""A disk, or a folder of a network, that went away: what the system says then, and what the user can do."""

import errno

NAMES = (
    "EIO", "ESTALE", "ENOTCONN", "ETIMEDOUT", "EHOSTDOWN", "EHOSTUNREACH", "ENETDOWN", "ENETUNREACH", "ENODEV", "ENXIO",
    "EREMOTEIO",
)  # fmt: skip
"""Not every system has all of them."""

LOST_DISK = frozenset(getattr(errno, name) for name in NAMES if hasattr(errno, name))
"""Error numbers of reading and writing where no file is to blame."""

MOUNT_AGAIN = "the disk or network folder it lies on does not answer; mount it again, then repeat the command"


def what_helps(error: OSError, otherwise: str) -> str:
    """What helps where a disk is gone, else what helps ``otherwise``."""
    return MOUNT_AGAIN if error.errno in LOST_DISK else otherwise
