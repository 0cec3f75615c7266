"""Files that a scene names: bad names, and disks that do not answer, are told apart."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from scene_folders import nerfstudio_document, write_colmap, write_image, write_mask, write_nerfstudio

from ringlight.core.lost_disk import MOUNT_AGAIN
from ringlight.data.folder import file_inside, image_inside
from ringlight.data.load import load_scene
from ringlight.errors import SceneError

LONGEST = 255
"""Bytes of a name that file systems take."""


def refusing(below: Path, code: int) -> Callable[..., os.stat_result]:
    """In place of ``os.lstat`` and ``os.stat``: nothing is told of what lies below the folder."""
    asked = os.stat

    def stat(path: object, *, follow_symlinks: bool = True, **_: object) -> os.stat_result:
        if isinstance(path, str | Path) and str(path).startswith(f"{below}{os.sep}"):
            raise OSError(code, os.strerror(code), str(path))
        return asked(path, follow_symlinks=follow_symlinks)

    return stat


@pytest.mark.parametrize(
    ("code", "remedy"),
    [(errno.EACCES, "check the path and its permissions"), (errno.ESTALE, MOUNT_AGAIN), (errno.EIO, MOUNT_AGAIN)],
)
@pytest.mark.parametrize("write", [write_nerfstudio, write_colmap])
def test_photographs_of_which_the_disk_tells_nothing_have_no_bad_names(
    tmp_path: Path, write: Callable[[Path], Path], code: int, remedy: str, monkeypatch: pytest.MonkeyPatch
):
    """As in a folder without the right to search it, and where a network folder went away."""
    folder = write(tmp_path)
    with monkeypatch.context() as lost:
        lost.setattr(Path, "stat", refusing(folder / "images", code))
        lost.setattr(Path, "lstat", refusing(folder / "images", code))
        with pytest.raises(SceneError, match=rf"images/.*\.png: cannot be read \({os.strerror(code)}\); {remedy}"):
            load_scene(folder)


@pytest.mark.parametrize("length", [LONGEST - 3, LONGEST])
def test_the_longest_names_go_with_a_folder_of_masks(tmp_path: Path, length: int):
    """Whose usual name, with .png behind, no file can have."""
    document, count = nerfstudio_document(), 9
    for index in range(count):
        name = f"images/{index}{'a' * (length - 5)}.png"
        document["frames"][index]["file_path"] = name
        write_image(tmp_path / name)
        write_mask(tmp_path / "masks" / Path(name).name)
    scene = load_scene(write_nerfstudio(tmp_path, document))
    assert f"masks: masks/ ({count} of {count} photographs)" in scene.notes


def test_a_missing_image_of_a_long_name_is_missing(tmp_path: Path):
    name = "a" * (LONGEST - 4) + ".png"
    assert image_inside(tmp_path, name, "the test") is None
    write_image(tmp_path / f"{name[:-4]}.jpg")
    assert image_inside(tmp_path, name, "the test") == tmp_path / f"{name[:-4]}.jpg"


@pytest.mark.parametrize("name", ["a" * (LONGEST + 1), "a\0b", "\ud800"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path, name: str):
    for inside in (file_inside, image_inside):
        with pytest.raises(SceneError, match=r"the test names the file .*, which no file can be called; correct"):
            inside(tmp_path, name, "the test")
