"""A file is there complete or not at all, whatever goes wrong on the way."""

import errno
import os
import resource
import stat
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO

import pytest

from ringlight.errors import OutputError
from ringlight.files.atomic import refuse_existing, write_text, written_atomically


def failing_with(error: BaseException) -> Callable[[BinaryIO], None]:
    def write(file: BinaryIO) -> None:
        file.write(b"half of it")
        raise error

    return write


def write_atomically(path: Path, write: Callable[[BinaryIO], None]) -> None:
    with written_atomically(path) as file:
        write(file)


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def write_a_megabyte(file: BinaryIO) -> None:
    file.write(bytes(1_000_000))


def test_the_file_holds_what_was_written_and_nothing_else_is_left(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "first")
    write_text(tmp_path / "a.txt", "zweite Fassung: größer")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "zweite Fassung: größer"
    assert names_in(tmp_path) == ["a.txt"]


def test_the_writer_may_seek_back(tmp_path: Path) -> None:
    with written_atomically(tmp_path / "a.bin") as file:
        file.write(b"....tail")
        file.seek(0)
        file.write(b"head")
    assert (tmp_path / "a.bin").read_bytes() == b"headtail"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_failing_disk_leaves_the_old_file_and_is_one_sentence(tmp_path: Path, code: int) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(OutputError, match=r"a\.bin: cannot be written: .+; .+") as caught:
        write_atomically(path, failing_with(OSError(code, os.strerror(code))))
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == b"old"
    assert names_in(tmp_path) == ["a.bin"]


def test_a_real_limit_on_the_file_size_is_such_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # compiled modules would be cut off at the limit
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(OutputError, match="largest size allowed"):
            write_atomically(path, write_a_megabyte)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == b"old"
    assert names_in(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("a bug")])
def test_other_failures_pass_through_and_leave_no_trace(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)):
        write_atomically(tmp_path / "a.bin", failing_with(error))
    assert names_in(tmp_path) == []


def test_what_is_no_file_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        write_text(tmp_path / "folder", "text")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="not a regular file"):
        write_text(tmp_path / "pipe", "text")
    assert (tmp_path / "pipe").is_fifo()


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="folder does not exist"):
        write_text(tmp_path / "nowhere" / "a.txt", "text")


def test_a_symbolic_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


def test_a_folder_that_may_not_be_written_is_refused_before_long_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    refuse_existing(tmp_path / "x.ply", overwrite=False)
    assert not list(tmp_path.iterdir())

    def refused(path: Path, **_: object) -> None:
        raise OSError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "touch", refused)
    with pytest.raises(OutputError, match="permission is denied; choose a folder you may read and write"):
        refuse_existing(tmp_path / "x.ply", overwrite=False)


WRITERS = (partial(write_text, text="new"), partial(refuse_existing, overwrite=True))


@pytest.mark.parametrize("write", WRITERS)
def test_a_name_that_no_disk_takes_is_one_sentence(tmp_path: Path, write: Callable[[Path], None]) -> None:
    with pytest.raises(OutputError, match="a: cannot be written: its name is too long for this disk; choose a shorter"):
        write(tmp_path / ("a" * 300))
    assert names_in(tmp_path) == []


@pytest.mark.parametrize("write", WRITERS)
def test_links_in_a_circle_are_one_sentence(tmp_path: Path, write: Callable[[Path], None]) -> None:
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match=r"loop: cannot be written: .*; choose another path"):
        write(tmp_path / "loop")
    assert (tmp_path / "loop").is_symlink()


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize(
    ("code", "remedy"),
    [(errno.ESTALE, "mount it again"), (errno.EIO, "mount it again"), (errno.EACCES, "choose a folder you may read")],
)
def test_a_disk_that_tells_nothing_of_a_file_is_one_sentence(
    tmp_path: Path, code: int, remedy: str, write: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(path: Path, **_: object) -> os.stat_result:
        raise OSError(code, os.strerror(code), str(path))

    with monkeypatch.context() as lost:
        lost.setattr(Path, "stat", gone)
        with pytest.raises(OutputError, match=rf"a\.txt: cannot be written: .*{remedy}"):
            write(tmp_path / "a.txt")
    assert names_in(tmp_path) == []


def failing_on_folders(call: Callable, code: int) -> Callable:
    """The call, which fails for a folder, be it named or open."""

    def failing(what: object, *others: object) -> object:
        if stat.S_ISDIR(os.fstat(what).st_mode) if isinstance(what, int) else Path(str(what)).is_dir():
            raise OSError(code, os.strerror(code))
        return call(what, *others)

    return failing


@pytest.mark.parametrize("write", WRITERS)
def test_a_folder_that_may_not_be_read_is_refused_before_a_file_is_replaced(
    tmp_path: Path, write: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.txt").write_text("old")
    with monkeypatch.context() as unreadable:
        unreadable.setattr(os, "open", failing_on_folders(os.open, errno.EACCES))
        with pytest.raises(OutputError, match="permission is denied; choose a folder you may read and write"):
            write(tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "old"
    assert names_in(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("code", [errno.EINVAL, errno.ENOTSUP])
def test_a_folder_that_knows_no_flushing_takes_files(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", failing_on_folders(os.fsync, code))
    write_text(tmp_path / "a.txt", "new")
    refuse_existing(tmp_path / "b.txt", overwrite=False)
    assert (tmp_path / "a.txt").read_text() == "new"
    with pytest.raises(OutputError, match="cannot be written"):  # a failure of the block is none of the folder's
        write_atomically(tmp_path / "a.txt", failing_with(OSError(code, os.strerror(code))))


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that takes no files, whoever asks, is Linux's")
def test_a_folder_that_takes_no_files_is_not_called_missing() -> None:
    for write in (partial(refuse_existing, overwrite=False), partial(write_text, text="")):
        with pytest.raises(OutputError, match="its folder takes no new files; choose another folder"):
            write(Path("/proc/x.ply"))
