"""What the system refuses is one sentence with a remedy that fits, whatever command met it."""

import errno
import os
import sys
from pathlib import Path

import pytest
from command import Command
from refusal import SHORT, refused

from ringlight.cli.system_refusals import sentence_on

LONG = "a" * 300
"""Longer than the 255 bytes that file systems take."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other limits and error numbers")


def test_a_name_longer_than_the_disk_takes(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    for words in (
        ("info", tmp_path / LONG),
        ("eval", tmp_path / LONG),
        ("train", tmp_path / LONG, "3dgs", *SHORT),
        ("train", tiny, "3dgs", "--out", tmp_path / LONG, *SHORT),
        ("export", trained["3dgs"], tmp_path / f"{LONG}.ply"),
    ):
        refused(ringlight(*words), 1, LONG, "too long")


def test_links_in_a_circle(tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    refused(ringlight("train", loop, "3dgs", *SHORT), 1, loop)
    assert list(tmp_path.iterdir()) == [loop]


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENAMETOOLONG, "shorter"),
        (errno.ELOOP, "circle"),
        (errno.ENOTDIR, "another path"),
        (errno.EISDIR, "name a file"),
        (errno.EFBIG, "largest size"),
        (errno.EMFILE, "ulimit -n"),
        (errno.ENOSPC, "free some space, or choose another place"),
        (errno.EACCES, "change its permissions, or choose another place"),
        (errno.EROFS, "choose another place"),
    ],
)
def test_each_number_has_its_remedy(number: int, remedy: str) -> None:
    sentence = sentence_on(OSError(number, os.strerror(number), "place"))
    assert sentence is not None
    assert sentence.startswith(f"place: {os.strerror(number)}; ")
    assert remedy in sentence
    assert "--out" not in sentence, "export takes its file as a word, and others too"


def test_too_many_files_are_not_blamed_on_standard_output() -> None:
    sentence = sentence_on(OSError(errno.EMFILE, os.strerror(errno.EMFILE)))
    assert sentence is not None
    assert "standard output" not in sentence
    assert sentence_on(OSError(errno.ECHILD, os.strerror(errno.ECHILD))) is None, "a bug is no refusal"
