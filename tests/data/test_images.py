"""Photographs: lazy, 8 bit, one filter, and damage that raises one sentence."""

import copy
import io
import pickle
import struct
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scene_folders import write_blender, write_image

from ringlight.data.image_files import read_header
from ringlight.data.images import Photograph, PixelBudget, target_size
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, SceneError


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (SceneOptions(), (1600, 1067)),
        (SceneOptions(max_width=4000), (3000, 2000)),
        (SceneOptions(max_width=100), (100, 67)),
        (SceneOptions(downscale=1), (3000, 2000)),
        (SceneOptions(downscale=4), (750, 500)),
        (SceneOptions(downscale=7), (429, 286)),
        (SceneOptions(downscale=500), (6, 4)),
        (SceneOptions(max_width=6), (6, 4)),
    ],
)
def test_sizes(options: SceneOptions, expected: tuple[int, int]):
    assert target_size(3000, 2000, options) == expected


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            SceneOptions(downscale=5000),
            "--downscale 5000 leaves 1x0 pixels of photographs of 3000x2000; give at most 500",
        ),
        (SceneOptions(max_width=5), "--max-width 5 leaves 5x3 pixels of photographs of 3000x2000; give at least 6"),
    ],
)
def test_pictures_that_show_nothing_are_refused(options: SceneOptions, words: str):
    with pytest.raises(RecipeError, match=f"^{words}$"):
        target_size(3000, 2000, options)
    assert target_size(3, 2, SceneOptions()) == (3, 2)


def test_the_bound_that_is_the_default_is_called_so():
    with pytest.raises(RecipeError, match=r"^--max-width 1600, the default, leaves 1600x2 pixels"):
        target_size(8000, 12, SceneOptions())


def test_pixels_are_those_of_the_file_and_are_kept(tmp_path: Path):
    write_image(tmp_path / "a.png", mode="RGBA")
    photograph = Photograph(tmp_path / "a.png", 16, 12)
    pixels = photograph()
    assert pixels.dtype == np.uint8
    assert np.array_equal(pixels, np.array(Image.open(tmp_path / "a.png")))
    assert photograph() is pixels


def test_nothing_is_decoded_before_it_is_asked_for(tmp_path: Path):
    folder = write_blender(tmp_path)
    path = folder / "train" / "r_1.png"
    path.write_bytes(path.read_bytes()[:100])
    scene = load_scene(folder)
    scene.train[0].image(torch.ones(3))
    with pytest.raises(SceneError, match=r"r_1\.png: not a readable image \(.*copy or export the image again"):
        scene.train[1].image(torch.ones(3))
    path.unlink()
    with pytest.raises(SceneError, match=r"r_1\.png"):
        scene.train[1].image(torch.ones(3))


def decode(path: Path) -> np.ndarray:
    header = read_header(path)
    return Photograph(path, header.width, header.height)()


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_an_image_cut_anywhere_is_one_sentence(tmp_path: Path, kind: str):
    buffer = io.BytesIO()
    pixels = np.random.default_rng(0).integers(0, 256, (9, 11, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(buffer, kind)
    path, whole = tmp_path / "a.png", buffer.getvalue()
    # The last bytes close the container; pixels may be complete without them.
    for length in range(0, len(whole) - 40, 3):
        path.write_bytes(whole[:length])
        with pytest.raises(SceneError, match=r"a\.png: not a readable image") as caught:
            decode(path)
        assert "\n" not in str(caught.value)


def test_other_kinds_of_images_are_read_as_colours(tmp_path: Path):
    grey = Image.fromarray(np.full((4, 5), 77, np.uint8))
    for kind, channels in (("L", 3), ("LA", 4), ("P", 3), ("CMYK", 3)):
        path = tmp_path / f"{kind}.{'tif' if kind == 'CMYK' else 'png'}"
        grey.convert(kind).save(path)
        assert read_header(path).has_alpha == (channels == 4)
        assert Photograph(path, 5, 4)().shape == (4, 5, channels)
        assert (Photograph(path, 5, 4)()[..., :3] == 77).all()


def test_a_palette_with_a_transparent_entry_has_alpha(tmp_path: Path):
    palette = Image.new("P", (5, 4), 0)
    palette.putpalette([10, 20, 30, 40, 50, 60])
    palette.save(tmp_path / "p.png", transparency=0)
    assert read_header(tmp_path / "p.png").has_alpha
    assert (Photograph(tmp_path / "p.png", 5, 4)()[..., 3] == 0).all()


def test_shrinking_is_antialiased(tmp_path: Path):
    stripes = np.zeros((32, 32, 3), np.uint8)
    stripes[:, ::2] = 255
    Image.fromarray(stripes).save(tmp_path / "stripes.png")
    shrunk = Photograph(tmp_path / "stripes.png", 8, 8)()
    assert np.abs(shrunk[:, 1:-1].astype(int) - 127).max() <= 3


def test_hidden_colours_do_not_bleed_into_visible_ones(tmp_path: Path):
    pixels = np.zeros((32, 32, 4), np.uint8)
    pixels[:, :15] = (255, 0, 0, 255)
    pixels[:, 15:] = (0, 255, 0, 0)
    Image.fromarray(pixels).save(tmp_path / "edge.png")
    shrunk = Photograph(tmp_path / "edge.png", 8, 8)()
    visible = shrunk[shrunk[..., 3] > 20]
    assert (visible[:, 1] <= 4).all()
    assert (visible[:, 0] >= 250).all()


def test_views_have_the_size_of_their_pixels(tmp_path: Path):
    scene = load_scene(write_blender(tmp_path), SceneOptions(max_width=7))
    view = scene.train[0]
    assert view.load().shape == (view.camera.height, view.camera.width, 4) == (5, 7, 4)
    assert view.camera.center == pytest.approx((3.5, 2.5))
    assert any("16x12 pixels downscaled to 7x5 by Lanczos" in note for note in scene.notes)


def test_photographs_are_kept_while_their_memory_lasts_and_are_the_same_afterwards(tmp_path: Path):
    budget = PixelBudget(2 * 16 * 12 * 3 + 1)
    photographs = []
    for index in range(4):
        write_image(tmp_path / f"{index}.png", seed=index)
        photographs.append(Photograph(tmp_path / f"{index}.png", 16, 12, budget))
    first = [photograph() for photograph in photographs]
    again = [photograph() for photograph in photographs]
    assert [a is b for a, b in zip(first, again, strict=True)] == [True, True, False, False]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert budget.left == 1


def test_photographs_go_to_other_processes(tmp_path: Path):
    write_image(tmp_path / "a.png")
    photograph = Photograph(tmp_path / "a.png", 16, 12, PixelBudget(10_000))
    for copied in (copy.deepcopy(photograph), pickle.loads(pickle.dumps(photograph))):
        assert np.array_equal(copied(), photograph())


def test_several_threads_decode_a_photograph_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_image(tmp_path / "a.png", (400, 300))
    budget, decoded = PixelBudget(400 * 300 * 3), []
    decode = Photograph._decoded
    monkeypatch.setattr(Photograph, "_decoded", lambda photograph: decoded.append(1) or decode(photograph))
    photograph = Photograph(tmp_path / "a.png", 400, 300, budget)
    with ThreadPoolExecutor(8) as threads:
        found = [future.result() for future in [threads.submit(photograph) for _ in range(8)]]
    assert len(decoded) == 1
    assert all(pixels is found[0] for pixels in found)
    assert budget.left == 0


STREAMED = """
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.core.memory import machine_memory

def peak():
    [line] = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1000

scene = load_scene(sys.argv[1], SceneOptions(photo_memory=20e6 / machine_memory()))
scene.train[0].load()
before = peak()
total = sum(view.load().nbytes for view in scene.train) / 1e6
print(total, peak() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_scene_larger_than_its_memory_streams(tmp_path: Path):
    folder = write_blender(tmp_path / "scene", train=60)
    write_image(tmp_path / "large.png", size=(1000, 1000))
    for index in range(60):
        (folder / "train" / f"r_{index}.png").unlink()
        (folder / "train" / f"r_{index}.png").hardlink_to(tmp_path / "large.png")
    done = subprocess.run([sys.executable, "-c", STREAMED, folder], check=True, capture_output=True, text=True)
    total, used = map(float, done.stdout.split())
    assert total == 180
    assert used < 40, "MB: 20 are kept, and a photograph is decoded"


def png(width: int, height: int, data: bytes) -> bytes:
    """A PNG of 8-bit RGB that says so, with whatever data."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("width", "height", "reason"),
    [
        (9_000, 9_000, "more than its bytes can hold"),
        (20_000, 20_000, "more than its bytes can hold"),
        (2**31 - 1, 2**31 - 1, ""),
    ],
)
def test_a_decompression_bomb_is_refused_unread(tmp_path: Path, width: int, height: int, reason: str):
    path = tmp_path / "bomb.png"
    path.write_bytes(png(width, height, zlib.compress(bytes(100_000), 9)))
    for action in (lambda: read_header(path), Photograph(path, 10, 10)):
        with pytest.raises(SceneError, match=rf"bomb\.png: not a readable image \(.*{reason}"):
            action()


def test_a_plain_image_is_no_bomb(tmp_path: Path):
    for suffix in ("png", "jpg", "bmp"):
        Image.new("L", (3000, 3000), 255).save(tmp_path / f"plain.{suffix}", optimize=True)
        assert read_header(tmp_path / f"plain.{suffix}").width == 3000


@pytest.mark.parametrize("kind", ["EPS", "GIF", "PPM", "PDF"])
def test_formats_that_are_no_photographs_are_not_opened(tmp_path: Path, kind: str):
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png", kind)
    with pytest.raises(SceneError, match="of no known format"):
        read_header(tmp_path / "a.png")
