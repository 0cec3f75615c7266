"""What helps where a disk went away, and where something else is wrong."""

import errno

import pytest

from ringlight.core.lost_disk import MOUNT_AGAIN, what_helps


@pytest.mark.parametrize(
    ("number", "helps"), [(errno.EIO, MOUNT_AGAIN), (errno.ETIMEDOUT, MOUNT_AGAIN), (errno.EACCES, "choose another")]
)
def test_only_a_lost_disk_is_to_be_mounted_again(number: int, helps: str):
    assert what_helps(OSError(number, "words"), "choose another") == helps
