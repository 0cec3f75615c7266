"""The photographs of a scene: found, checked, linked, and never touched."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ringlight.errors import SceneError
from ringlight.poses.photographs import SceneFolders, photographs_in, safe_names, take


@pytest.fixture
def folders(tmp_path: Path) -> SceneFolders:
    made = SceneFolders(tmp_path / "scene")
    for folder in (made.images, made.masks, made.over_grey):
        folder.mkdir(parents=True)
    return made


def saved(path: Path, mode: str = "RGB", **exif: object) -> Path:
    channels = len(mode)
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, channels), np.uint8)
    tags = Image.Exif()
    for name, value in exif.items():
        tags[{"orientation": 0x0112, "make": 0x010F, "model": 0x0110}[name]] = value
    Image.fromarray(pixels).save(path, exif=tags)
    return path


def decoded(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.array(image)


def test_photographs_are_found_in_the_usual_folders_by_name(tmp_path: Path):
    (tmp_path / "input").mkdir()
    for name in ("b.JPG", "a.png", "notes.txt", ".hidden.jpg"):
        (tmp_path / "input" / name).touch()
    assert [path.name for path in photographs_in(tmp_path)] == ["a.png", "b.JPG"]
    assert photographs_in(tmp_path / "input") == photographs_in(tmp_path)


def test_no_photographs_are_one_sentence(tmp_path: Path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(SceneError, match="holds no photographs"):
        photographs_in(tmp_path)
    with pytest.raises(SceneError, match="no such folder"):
        photographs_in(tmp_path / "missing")


def test_names_lose_what_lists_cannot_hold_and_stay_different():
    paths = [Path(name) for name in ("IMG 1.JPG", "IMG_1.jpg", "IMG\n1.jpg", "é-2.png", "x\x1b[2J.png")]
    names = safe_names(paths)
    assert names == ["IMG_1.jpg", "IMG_1-2.jpg", "IMG_1-3.jpg", "é-2.png", "x_2J.png"]


def test_a_photograph_is_linked_and_stays(tmp_path: Path, folders: SceneFolders):
    path = saved(tmp_path / "a.jpg", orientation=6, make="Maker", model="Model\0")
    before = path.read_bytes()
    taken = take(path, "a.jpg", folders)
    assert path.samefile(folders.images / "a.jpg")
    assert path.read_bytes() == before
    assert (taken.orientation, taken.has_exif_camera, taken.is_cut_out) == (6, True, False)
    assert taken.lens[:2] == ("30", "20"), "as stored: COLMAP does not turn pictures either"
    assert take(path, "a.jpg", folders) == taken


def test_another_disk_gets_a_copy(tmp_path: Path, folders: SceneFolders, monkeypatch: pytest.MonkeyPatch):
    def refuse(*names: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    monkeypatch.setattr(os, "link", refuse)
    path = saved(tmp_path / "a.jpg")
    take(path, "a.jpg", folders)
    assert not path.samefile(folders.images / "a.jpg")
    assert path.read_bytes() == (folders.images / "a.jpg").read_bytes()


def test_a_cut_out_photograph_gets_a_mask_and_a_copy_over_grey(tmp_path: Path, folders: SceneFolders):
    pixels = np.full((20, 30, 4), 200, np.uint8)
    pixels[:, :10, 3], pixels[:, 10:, 3] = 0, 255
    Image.fromarray(pixels).save(tmp_path / "a.png")
    taken = take(tmp_path / "a.png", "a.png", folders)
    assert taken.is_cut_out
    mask = decoded(folders.masks / "a.png.png")
    np.testing.assert_array_equal(mask > 0, pixels[..., 3] > 0)
    flat = decoded(folders.over_grey / "a.png")
    assert flat.shape == (20, 30, 3)
    assert set(flat[:, :10].ravel()) == {128}
    assert set(flat[:, 10:].ravel()) == {200}


def test_an_opaque_alpha_is_no_mask(tmp_path: Path, folders: SceneFolders):
    pixels = np.full((20, 30, 4), 255, np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    assert not take(tmp_path / "a.png", "a.png", folders).is_cut_out
    assert not list(folders.masks.iterdir())


def test_a_damaged_photograph_is_refused_and_not_linked(tmp_path: Path, folders: SceneFolders):
    path = saved(tmp_path / "a.jpg")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(SceneError, match=r"a\.jpg: not a readable image"):
        take(path, "a.jpg", folders)
    assert not list(folders.images.iterdir())


def test_what_colmap_cannot_read_becomes_a_png(tmp_path: Path, folders: SceneFolders):
    path = tmp_path / "a.avif"
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    Image.new("RGB", (30, 20), (200, 100, 50)).save(path, exif=exif)
    assert safe_names([path]) == ["a.png"]
    taken = take(path, "a.png", folders)
    assert (taken.orientation, taken.has_exif_camera) == (1, True)
    with Image.open(folders.images / "a.png") as image:
        assert (image.format, image.size) == ("PNG", (30, 20))


@pytest.mark.parametrize("kind", ["WEBP", "AVIF"])
def test_what_is_called_a_jpeg_and_is_none_can_be_read_by_colmap(kind: str, tmp_path: Path, folders: SceneFolders):
    """COLMAP finds no features in these, and says nothing."""
    picture = Image.fromarray(np.random.default_rng(1).integers(0, 256, (24, 32, 3), dtype=np.uint8))
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    picture.save(tmp_path / "a.jpg", kind, exif=exif)
    taken = take(tmp_path / "a.jpg", "a.jpg", folders)
    with Image.open(folders.images / "a.jpg") as placed:
        assert placed.format == "PNG"
    np.testing.assert_array_equal(decoded(folders.images / "a.jpg"), decoded(tmp_path / "a.jpg"))
    assert "Maker" in taken.lens


def test_a_link_whose_file_is_gone_counts_among_the_photographs(tmp_path: Path, folders: SceneFolders):
    (tmp_path / "photos").mkdir()
    saved(tmp_path / "photos" / "a.png")
    (tmp_path / "photos" / "b.png").symlink_to(tmp_path / "nowhere.png")
    (tmp_path / "photos" / ".b.png").symlink_to(tmp_path / "nowhere.png")
    assert [path.name for path in photographs_in(tmp_path / "photos")] == ["a.png", "b.png"]
    with pytest.raises(SceneError, match=r"b\.png: not a readable image \(No such file"):
        take(tmp_path / "photos" / "b.png", "b.png", folders)
