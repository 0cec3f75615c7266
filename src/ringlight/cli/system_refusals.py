"""What the operating system refuses and the user can mend, as a sentence each."""

import errno

from ringlight.core.lost_disk import LOST_DISK, MOUNT_AGAIN

ANOTHER_PLACE = "choose another place"
"""Some commands take it as a word, others by a flag, and this is not told which one asks."""

FREE_SPACE = f"free some space, or {ANOTHER_PLACE}"
PERMISSIONS = f"change its permissions, or {ANOTHER_PLACE}"

REMEDIES = {
    errno.ENOSPC: FREE_SPACE,
    errno.EDQUOT: FREE_SPACE,
    errno.EACCES: PERMISSIONS,
    errno.EPERM: PERMISSIONS,
    errno.EROFS: ANOTHER_PLACE,
    errno.EFBIG: f"raise the largest size allowed for a file, or {ANOTHER_PLACE}",
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ELOOP: "its links lead in a circle: mend them, or give another path",
    errno.ENOTDIR: "part of its path is a file, not a folder: give another path",
    errno.EISDIR: "it is a folder: name a file",
    errno.EMFILE: "close some, or raise the limit with 'ulimit -n'",
} | dict.fromkeys(LOST_DISK, MOUNT_AGAIN)
"""What the user can do, by error number. Any other is a bug."""

OF_STREAMS = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EPERM, errno.EROFS}
"""Those that without a file's name are of standard output; the others are of one file or another."""


def sentence_on(error: OSError) -> str | None:
    """What was refused, where, and the remedy; None where the user can mend nothing."""
    if error.errno not in REMEDIES:
        return None
    if error.filename is not None:
        return f"{error.filename}: {error.strerror}; {REMEDIES[error.errno]}"
    if error.errno not in OF_STREAMS:
        return f"a file cannot be read or written ({error.strerror}); {REMEDIES[error.errno]}"
    return f"standard output: {error.strerror}; free some space, or send it to another file"


def met_in_links(error: BaseException) -> OSError | None:
    """What ``Path.resolve`` met where it raised this: up to Python 3.12 it hides a circle of links in a
    RuntimeError."""
    met = error.__context__
    return met if isinstance(met, OSError) and met.errno == errno.ELOOP else None
