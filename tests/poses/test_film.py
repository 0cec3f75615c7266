"""The frames of a film: sharp ones, evenly along the way; a black film and one that stands still are refused."""

import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter
from textured_room import texture

from ringlight.errors import SceneError
from ringlight.files.video import write_video
from ringlight.poses.film import MOVED, Look, block_motion, choose, sharpness, take_frames

WIDTH, HEIGHT = 192, 128


def film_of(path: Path, places: list[int], blurred: set[int] = frozenset()) -> None:
    """A window that slides over a texture, one frame a place, some of them out of focus."""
    wall = np.tile(texture(3), (1, 2, 1)) / 255
    frames = []
    for index, left in enumerate(places):
        view = wall[100 : 100 + HEIGHT, left : left + WIDTH]
        view = gaussian_filter(view, (4, 4, 0)) if index in blurred else view
        frames.append(torch.tensor(view, dtype=torch.float32))
    write_video(path, frames, 25.0)


def ignore(done: int, total: int) -> None:
    """Nobody watches."""


def test_frames_are_sharp_and_evenly_spaced(tmp_path: Path):
    film = tmp_path / "a walk\x1b[2J.mp4"
    places = list(range(0, 160, 2))
    blurred = {index for index in range(80) if index % 3}
    film_of(film, places, blurred)
    images = tmp_path / "images"
    images.mkdir()
    names = take_frames(film, images, 150, ignore)
    chosen = [int(Path(name).stem.rpartition("-")[2]) for name in names]
    assert not blurred & set(chosen)
    steps = np.diff([places[index] for index in chosen]) / WIDTH
    assert (steps > 0.4 * MOVED).all()
    assert (steps < 3 * MOVED).all(), "motion between a sharp and a blurred frame is found too small, not too large"
    assert {path.name for path in images.iterdir()} == set(names)
    assert names[0].startswith("a_walk_2J-0000")
    with Image.open(images / names[0]) as frame:
        assert frame.size == (WIDTH, HEIGHT)


def test_no_more_frames_than_asked_for_and_still_of_the_whole_film(tmp_path: Path):
    film_of(tmp_path / "film.mp4", list(range(0, 240, 3)))
    (tmp_path / "images").mkdir()
    names = take_frames(tmp_path / "film.mp4", tmp_path / "images", 6, ignore)
    assert 4 <= len(names) <= 6
    assert int(names[-1][-10:-4]) > 60


@pytest.mark.parametrize(
    ("frames", "said"),
    [(np.zeros((12, 64, 96, 3)), "shows nothing"), (np.tile(texture(1)[None, :64, :96] / 255, (12, 1, 1, 1)), "moves")],
)
def test_a_film_that_shows_nothing_or_stands_still_is_refused(frames: np.ndarray, said: str, tmp_path: Path):
    film = tmp_path / "film.mp4"
    write_video(film, torch.tensor(frames, dtype=torch.float32), 25.0)
    with pytest.raises(SceneError, match=said):
        take_frames(film, tmp_path, 100, ignore)


def test_what_is_no_film_is_refused(tmp_path: Path):
    (tmp_path / "film.mp4").write_bytes(b"not a film" * 100)
    with pytest.raises(SceneError, match=r"film\.mp4: cannot be read as a film"):
        take_frames(tmp_path / "film.mp4", tmp_path, 100, ignore)


@pytest.mark.parametrize("shift", [(0, 0), (3, -5), (-8, 2)])
def test_the_motion_of_blocks_is_found(shift: tuple[int, int]):
    wall = texture(0)[..., 0].astype(np.float32)
    here = wall[100:228, 100:292]
    there = wall[100 - shift[0] : 228 - shift[0], 100 - shift[1] : 292 - shift[1]]
    motion = block_motion(here, there)
    assert motion.shape == (24, 2)
    np.testing.assert_array_equal(np.median(motion, axis=0), shift)


def test_blocks_that_show_nothing_have_no_motion():
    wall = texture(0)[:128, :128, 0].astype(np.float32)
    wall[:64] = 90
    assert np.isnan(block_motion(wall, wall)).all(1).sum() == 8


def test_blur_lowers_sharpness():
    wall = texture(0)[..., 0].astype(np.float32)
    assert sharpness(gaussian_filter(wall, 1)) < 0.7 * sharpness(wall)


def test_the_sharpest_within_reach_is_chosen():
    looks = [Look(index, index * MOVED / 4, 5.0 if index % 4 == 1 else 1.0) for index in range(41)]
    assert choose(looks, 100) == [*range(1, 38, 4), 39]
    assert choose([], 10) == []


@pytest.mark.parametrize(("matrix", "turns"), [((0, 1, -1, 0), -1), ((0, -1, 1, 0), 1), ((-1, 0, 0, -1), 2)])
def test_frames_of_an_upright_film_are_upright(matrix: tuple[int, ...], turns: int, tmp_path: Path):
    """Telephones store what they film lying, and note by a matrix how it is shown: (x, y) at (ax + cy, bx + dy)."""
    film_of(tmp_path / "film.mp4", list(range(0, 60, 2)))
    content = bytearray((tmp_path / "film.mp4").read_bytes())
    start = content.index(b"tkhd") + 44  # ISO/IEC 14496-12, 8.3.2: version 0 has 40 bytes before the matrix
    a, b, c, d = (value * 65536 for value in matrix)
    assert struct.unpack_from(">9i", content, start) == (65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30)
    struct.pack_into(">9i", content, start, a, b, 0, c, d, 0, 0, 0, 1 << 30)
    (tmp_path / "turned.mp4").write_bytes(content)
    pictures = []
    for film in ("film", "turned"):
        (tmp_path / film).mkdir()
        names = take_frames(tmp_path / f"{film}.mp4", tmp_path / film, 10, ignore)
        pictures.append(np.asarray(Image.open(tmp_path / film / names[1])).astype(int))
    expected = np.rot90(pictures[0], turns)
    assert pictures[1].shape == expected.shape
    assert np.abs(pictures[1] - expected).mean() < 2, "but for what JPEG loses"
