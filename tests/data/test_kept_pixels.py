"""Undistorted photographs that somebody keeps: asked for before they are made, known by all that makes them."""

import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from deep_png import deep_png
from lenses import HEIGHT, REAL, WIDTH, read
from scene_folders import write_blender, write_image, write_mask

from ringlight.data import kept_pixels, undistort
from ringlight.data.images import Photograph, PixelBudget
from ringlight.data.kept_pixels import made_of
from ringlight.data.load import load_scene
from ringlight.data.mask_files import MaskFile
from ringlight.data.undistort import Undistortion, undistortion_of
from ringlight.errors import SceneError


@dataclass
class InMemory:
    """Keeps what it is given; ``asked`` are the names that were looked for."""

    kept: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)

    def find(self, name: str, made_of: str) -> np.ndarray | None:
        self.asked.append(name)
        known, pixels = self.kept.get(name, ("", None))
        return pixels if known == made_of else None

    def keep(self, name: str, made_of: str, pixels: np.ndarray) -> None:
        self.kept[name] = made_of, pixels


def lens(model: str = "OPENCV") -> Undistortion:
    made = undistortion_of(read(model, REAL[model]), "camera 1")
    assert made is not None
    return made


def photograph(path: Path, keeper: InMemory | None, mask: MaskFile | None = None) -> Photograph:
    made = lens()
    return Photograph(path, made.pinhole.width, made.pinhole.height, None, mask, made, "a", keeper)


@pytest.fixture(autouse=True)
def code_is_looked_at_again() -> Iterator[None]:
    yield
    kept_pixels._code.cache_clear()


@pytest.fixture
def resamplings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Gets an entry whenever pixels are resampled."""
    counted, resampled = [], undistort.resampled
    monkeypatch.setattr(undistort, "resampled", lambda *given: counted.append(1) or resampled(*given))
    return counted


@pytest.mark.parametrize("kind", ["RGB", "RGBA", "mask", "RGBA and mask", "16 bits"])
def test_kept_pixels_are_those_that_would_be_made(tmp_path: Path, resamplings: list[int], kind: str):
    path, mask, keeper = tmp_path / "a.png", None, InMemory()
    if kind == "16 bits":
        pixels = np.random.default_rng(0).integers(0, 1 << 16, (HEIGHT, WIDTH, 3), dtype=np.uint16)
        path.write_bytes(deep_png(pixels))
    else:
        write_image(path, (WIDTH, HEIGHT), "RGBA" if "RGBA" in kind else "RGB")
    if "mask" in kind:
        write_mask(tmp_path / "mask.png", (WIDTH, HEIGHT))
        mask = MaskFile(tmp_path / "mask.png")
    made = photograph(path, None, mask)()
    first, again = (photograph(path, keeper, mask)() for _ in range(2))
    assert np.array_equal(first, made)
    assert np.array_equal(again, made)
    assert made.shape[2] == (3 if kind in ("RGB", "16 bits") else 4)
    assert len(resamplings) == 2, "by none, and by the first with a keeper"


def test_photographs_of_pinholes_are_not_kept(tmp_path: Path):
    keeper = InMemory()
    scene = load_scene(write_blender(tmp_path), keeper=keeper)
    for view in scene.train:
        view.load()
    assert not keeper.asked
    assert not keeper.kept


@pytest.mark.parametrize("changed", ["photograph", "mask", "inverted", "no mask", "lens", "size", "code", "library"])
def test_any_change_makes_it_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str):
    path, mask, made = tmp_path / "a.png", MaskFile(tmp_path / "mask.png"), lens()
    write_image(path, (WIDTH, HEIGHT))
    write_mask(tmp_path / "mask.png", (WIDTH, HEIGHT))
    before = made_of(path, mask, made)
    assert before == made_of(path, mask, lens())
    if changed == "photograph":
        dates = path.stat()
        content = bytearray(path.read_bytes())
        content[-20] ^= 1  # neither its length nor its date tells
        path.write_bytes(content)
        os.utime(path, ns=(dates.st_atime_ns, dates.st_mtime_ns))
    elif changed == "mask":
        write_mask(tmp_path / "mask.png", (WIDTH, HEIGHT), kept=False)
    elif changed == "inverted":
        mask = replace(mask, is_inverted=True)
    elif changed == "no mask":
        mask = None
    elif changed == "lens":
        taken = made.photograph
        made = replace(made, photograph=replace(taken, lens=replace(taken.lens, radial=(-0.21, 0.0600001, 0.0))))
    elif changed == "size":
        made = made.at(made.pinhole.width - 1, made.pinhole.height)
    elif changed == "code":
        monkeypatch.setattr(kept_pixels, "MAKERS", ("hull", *kept_pixels.MAKERS[1:]))
    else:
        monkeypatch.setattr(kept_pixels, "_version", lambda library: "0" if library == "scipy" else None)
    kept_pixels._code.cache_clear()
    assert made_of(path, mask, made) not in (before, None)


def test_all_that_makes_the_pixels_counts():
    """Of this folder: what the modules that are counted import, but for records and words."""
    folder, innocent = Path(kept_pixels.__file__).parent, {"file_marks", "kept_pixels", "options"}
    for maker in kept_pixels.MAKERS:
        imported = re.findall(r"^\s*from ringlight\.data\.(\w+) import", (folder / f"{maker}.py").read_text(), re.M)
        assert set(imported) <= {*kept_pixels.MAKERS, *innocent}, maker


def test_a_copy_elsewhere_is_the_same(tmp_path: Path):
    write_image(tmp_path / "a.png", (WIDTH, HEIGHT))
    (tmp_path / "other").mkdir()
    copied = Path(shutil.copyfile(tmp_path / "a.png", tmp_path / "other" / "b.png"))
    os.utime(copied, (0, 0))
    assert made_of(copied, None, lens()) == made_of(tmp_path / "a.png", None, lens())


def test_a_photograph_that_is_gone_is_refused_though_it_was_kept(tmp_path: Path):
    path, keeper = tmp_path / "a.png", InMemory()
    write_image(path, (WIDTH, HEIGHT))
    photograph(path, keeper)()
    path.unlink()
    assert made_of(path, None, lens()) is None
    with pytest.raises(SceneError, match=r"a\.png: not a readable image"):
        photograph(path, keeper)()


def test_a_photograph_that_changes_while_it_is_decoded_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, keeper, make = tmp_path / "a.png", InMemory(), Photograph._made
    write_image(path, (WIDTH, HEIGHT))

    def make_and_change(taken: Photograph) -> np.ndarray:
        pixels = make(taken)
        write_image(path, (WIDTH, HEIGHT), seed=1)
        return pixels

    monkeypatch.setattr(Photograph, "_made", make_and_change)
    photograph(path, keeper)()
    assert not keeper.kept


def test_kept_pixels_of_another_size_are_made_anew(tmp_path: Path):
    path, keeper = tmp_path / "a.png", InMemory()
    write_image(path, (WIDTH, HEIGHT))
    made = photograph(path, keeper)()
    keeper.kept["a"] = keeper.kept["a"][0], made[1:]
    assert np.array_equal(photograph(path, keeper)(), made)
    assert keeper.kept["a"][1].shape == made.shape


def test_what_memory_does_not_hold_is_asked_of_the_keeper_each_time(tmp_path: Path, resamplings: list[int]):
    path, keeper = tmp_path / "a.png", InMemory()
    write_image(path, (WIDTH, HEIGHT))
    taken = replace(photograph(path, keeper), budget=PixelBudget(0))
    assert all(np.array_equal(taken(), taken()) for _ in range(2))
    assert keeper.asked == 4 * ["a"]
    assert len(resamplings) == 1
