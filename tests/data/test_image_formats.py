"""Formats of photographs: each gives the colours that were stored, at the precision that is promised."""

import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from deep_png import deep_png
from heic_sample import HEIC
from PIL import ExifTags, Image, features
from scene_folders import HEIGHT, WIDTH, write_blender

from ringlight.data.deep_images import from_sixteen_bits, rounded
from ringlight.data.image_files import decoded, opened, read_header
from ringlight.data.image_formats import identified
from ringlight.data.load import load_scene
from ringlight.data.mask_files import MaskFile
from ringlight.errors import SceneError

HEIC_COLORS = [[(220, 200, 90), (40, 200, 90)], [(220, 60, 90), (40, 60, 90)]]
"""Of the quarters of that sample, rows first."""

XMP = 700
"""The tag of TIFF under which it lies."""

RNG = np.random.default_rng(3)


def sixteen_bits(channels: int) -> np.ndarray:
    return RNG.integers(0, 65536, (HEIGHT, WIDTH, channels), dtype=np.uint16)


def write_tiff(path: Path, values: np.ndarray, order: str, packed: bool, orientation: int = 1) -> None:
    """One strip of 16-bit numbers in either byte order, stored or deflated."""
    height, width, channels = values.shape
    data = values.astype(f"{order}u2").tobytes()
    data = zlib.compress(data) if packed else data
    bits = struct.pack(f"{order}{channels}H", *[16] * channels)
    entries = [(256, 3, 1, width), (257, 3, 1, height), (258, 3, channels, None), (259, 3, 1, 8 if packed else 1)]
    entries += [(262, 3, 1, 2 if channels > 1 else 1), (273, 4, 1, 8)]
    entries += [(274, 3, 1, orientation), (277, 3, 1, channels), (278, 3, 1, height)]
    entries += [(279, 4, 1, len(data)), (284, 3, 1, 1)]
    entries += [(338, 3, 1, 2)] if channels == 4 else []  # the fourth is alpha, not premultiplied
    pad = data + b"\0" * (len(data) % 2)
    place = 8 + len(pad) + len(bits)
    directory = struct.pack(f"{order}H", len(entries))
    for tag, kind, count, value in entries:
        if value is None and channels > 1:
            content = struct.pack(f"{order}I", 8 + len(pad))
        else:
            content = struct.pack(f"{order}{'H' if kind == 3 else 'I'}", 16 if value is None else value)
        directory += struct.pack(f"{order}HHI", tag, kind, count) + content.ljust(4, b"\0")
    mark = b"II*\0" if order == "<" else b"MM\0*"
    path.write_bytes(mark + struct.pack(f"{order}I", place) + pad + bits + directory + b"\0" * 4)


def nearest(values: np.ndarray) -> np.ndarray:
    return np.round(values / 257).astype(np.uint8)


def test_every_sixteen_bit_number_becomes_the_nearest():
    values = np.arange(65536, dtype=np.uint16)
    ours = rounded((values >> 8).astype(np.uint8), (values & 255).astype(np.uint8))
    assert np.array_equal(ours, nearest(values))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("kind", ["png", "<", ">", "<packed", ">packed"])
def test_sixteen_bits_are_rounded_not_cut(tmp_path: Path, channels: int, kind: str):
    values, path = sixteen_bits(channels), tmp_path / f"deep.{'png' if kind == 'png' else 'tif'}"
    if kind == "png":
        path.write_bytes(deep_png(values))
    else:
        write_tiff(path, values, kind[0], packed="packed" in kind)
    header = read_header(path)
    assert (header.width, header.height, header.has_alpha, header.is_deep) == (WIDTH, HEIGHT, channels == 4, True)
    expected = np.repeat(nearest(values), 3, 2) if channels == 1 else nearest(values)
    assert np.array_equal(np.asarray(decoded(path)), expected)


def test_deep_colours_are_read_where_pillow_describes_files_by_plain_tuples(tmp_path: Path):
    values, path = sixteen_bits(3), tmp_path / "deep.png"
    path.write_bytes(deep_png(values))

    def opened_by_an_older_pillow() -> Image.Image:
        image = identified(path)
        image.tile = [tuple(tile) for tile in image.tile]
        return image

    image = from_sixteen_bits(opened_by_an_older_pillow(), opened_by_an_older_pillow)
    np.testing.assert_array_equal(np.asarray(image), nearest(values))


@pytest.mark.parametrize("channels", [1, 3])
def test_a_deep_colour_may_be_transparent(tmp_path: Path, channels: int):
    values = sixteen_bits(channels)
    values[2, 3:7] = values[5, 5]
    values[0, 0] = values[5, 5] ^ 1  # the same once it is rounded
    (tmp_path / "deep.png").write_bytes(deep_png(values, transparent=values[5, 5]))
    assert read_header(tmp_path / "deep.png").has_alpha
    pixels = np.asarray(decoded(tmp_path / "deep.png"))
    np.testing.assert_array_equal(pixels[..., 3] == 0, (values == values[5, 5]).all(-1))
    assert set(np.unique(pixels[..., 3])) == {0, 255}
    np.testing.assert_array_equal(pixels[..., :3], np.broadcast_to(nearest(values), (HEIGHT, WIDTH, 3)))


def test_a_deep_image_that_is_cut_is_one_sentence(tmp_path: Path):
    (tmp_path / "deep.png").write_bytes(deep_png(sixteen_bits(3)))
    whole = (tmp_path / "deep.png").read_bytes()
    for length in range(0, len(whole) - 40, 7):
        (tmp_path / "deep.png").write_bytes(whole[:length])
        with pytest.raises(SceneError, match=r"deep\.png: not a readable image"):
            decoded(tmp_path / "deep.png")


def test_the_scene_says_that_it_rounds(tmp_path: Path):
    folder = write_blender(tmp_path)
    assert not any("16 bits" in note for note in load_scene(folder).notes)
    (folder / "train" / "r_1.png").write_bytes(deep_png(sixteen_bits(4)))
    scene = load_scene(folder)
    assert "images: 16x12 pixels, 16 bits a channel rounded to 8, as they are" in scene.notes
    assert scene.train[1].load().shape == (HEIGHT, WIDTH, 4)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("compression", ["raw", "tiff_lzw"])
@pytest.mark.parametrize("mode", ["L", "P", "RGB", "RGBA", "I;16"])
def test_tiff_keeps_its_pixels_as_stored(tmp_path: Path, mode: str, compression: str, orientation: int):
    values = RNG.integers(0, 256, (HEIGHT, WIDTH, 4), dtype=np.uint8)
    if mode == "I;16":
        stored = Image.fromarray(values[..., 0].astype(np.uint16) * 257)
        expected = np.repeat(values[..., :1], 3, 2)
    else:
        stored = Image.fromarray(values[..., : 4 if mode == "RGBA" else 3]).convert(mode)
        expected = np.asarray(stored.convert("RGBA" if mode == "RGBA" else "RGB"))
    stored.save(tmp_path / "a.tif", compression=compression, tiffinfo={ExifTags.Base.Orientation: orientation})
    header = read_header(tmp_path / "a.tif")
    assert (header.width, header.height) == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(np.asarray(decoded(tmp_path / "a.tif")), expected)
    with opened(tmp_path / "a.tif") as image:
        assert image.getexif()[ExifTags.Base.Orientation] == orientation  # as who finds cameras wants to know


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["<", ">", "<packed", ">packed"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_deep_tiff_keeps_its_pixels_as_stored(tmp_path: Path, channels: int, kind: str, orientation: int):
    values = sixteen_bits(channels)
    write_tiff(tmp_path / "deep.tif", values, kind[0], "packed" in kind, orientation)
    header = read_header(tmp_path / "deep.tif")
    assert (header.width, header.height) == (WIDTH, HEIGHT)
    expected = np.repeat(nearest(values), 3, 2) if channels == 1 else nearest(values)
    np.testing.assert_array_equal(np.asarray(decoded(tmp_path / "deep.tif")), expected)


def test_an_orientation_in_xmp_turns_no_tiff(tmp_path: Path):
    values = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    xmp = b'<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
    Image.fromarray(values).save(tmp_path / "a.tif", tiffinfo={XMP: xmp})
    np.testing.assert_array_equal(np.asarray(decoded(tmp_path / "a.tif")), values)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("compression", ["raw", "group4"])
def test_a_mask_in_tiff_lies_as_it_is_stored(tmp_path: Path, compression: str, orientation: int):
    kept = RNG.integers(0, 2, (HEIGHT, WIDTH)).astype(bool)
    tags = {ExifTags.Base.Orientation: orientation}
    Image.fromarray(kept).save(tmp_path / "m.tif", compression=compression, tiffinfo=tags)
    mask = MaskFile(tmp_path / "m.tif")
    mask.refuse_other_size(WIDTH, HEIGHT, "a.jpg")
    np.testing.assert_array_equal(np.asarray(mask.alpha((WIDTH, HEIGHT))) > 0, kept)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("largest", [0, 1, 2, 65535])
@pytest.mark.parametrize("name", ["m.png", "m.tif"])
def test_a_deep_mask_of_labels_is_black_and_white(tmp_path: Path, name: str, largest: int, channels: int):
    kept = RNG.integers(0, 2, (HEIGHT, WIDTH)).astype(bool)
    values = np.repeat(kept[..., None] * np.uint16(largest), channels, 2)
    values[..., 3:] = 65535
    if name == "m.png":
        (tmp_path / name).write_bytes(deep_png(values))
    else:
        write_tiff(tmp_path / name, values, "<", packed=False)
    expected = kept * 255 if largest in (1, 65535) else np.zeros_like(kept)
    np.testing.assert_array_equal(np.asarray(MaskFile(tmp_path / name).alpha((WIDTH, HEIGHT))), expected)
    assert not largest or largest > 2 or not np.asarray(decoded(tmp_path / name))[..., :3].any()


def test_numbers_that_are_no_colours_are_refused(tmp_path: Path):
    Image.fromarray(np.full((4, 5), 0.5, np.float32)).save(tmp_path / "depth.tif")
    with pytest.raises(SceneError, match=r"depth\.tif: has pixels of kind 'F'; convert the image to RGB of 8 or 16"):
        read_header(tmp_path / "depth.tif")


def test_heic_is_read(tmp_path: Path):
    pytest.importorskip("pi_heif")
    path = tmp_path / "photograph.HEIC"
    path.write_bytes(HEIC)
    header = read_header(path)
    assert (header.width, header.height, header.has_alpha) == (WIDTH, HEIGHT, False)
    picture = decoded(path)
    for row in range(2):
        for column in range(2):
            color = picture.getpixel((4 + 8 * column, 3 + 6 * row))
            assert np.abs(np.subtract(color, HEIC_COLORS[row][column])).max() <= 3


@pytest.mark.skipif(not features.check("avif"), reason="this Pillow was built without AVIF")
@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
def test_avif_is_read(tmp_path: Path, mode: str):
    pixels = np.full((HEIGHT, WIDTH, len(mode)), 130, np.uint8)
    pixels[:, : WIDTH // 2, 0] = 210
    Image.fromarray(pixels).save(tmp_path / "a.avif", quality=100, subsampling="4:4:4")
    assert read_header(tmp_path / "a.avif").has_alpha == (mode == "RGBA")
    assert np.abs(np.asarray(decoded(tmp_path / "a.avif")).astype(int) - pixels).max() <= 3


def test_scenes_take_photographs_of_these_formats(tmp_path: Path):
    pytest.importorskip("pi_heif")
    folder = write_blender(tmp_path, mode="RGB")
    (folder / "train" / "r_1.png").unlink()
    (folder / "train" / "r_1.HEIC").write_bytes(HEIC)
    view = load_scene(folder).train[1]
    assert view.name == "train/r_1.HEIC"
    assert view.load().shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("kind", ["AVIF", "HEIC"])
def test_without_the_extra_it_is_named(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch):
    beginning = b"\0\0\0\x1cftypavif\0\0\0\0mif1avifmiaf" if kind == "AVIF" else HEIC
    (tmp_path / "a.jpg").write_bytes(beginning)
    monkeypatch.setattr(features, "check", lambda feature: False)
    for module in ("pi_heif", "pillow_heif"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(SceneError, match=rf"a\.jpg: is a photograph in {kind}, .*pip install 'ringlight\[photos\]'$"):
        read_header(tmp_path / "a.jpg")


@pytest.mark.parametrize("length", [12, 40, 200, 400, 600])
def test_a_heic_file_that_is_cut_is_one_sentence(tmp_path: Path, length: int):
    pytest.importorskip("pi_heif")
    (tmp_path / "a.heic").write_bytes(HEIC[:length])
    with pytest.raises(SceneError, match=r"a\.heic: not a readable image"):
        decoded(tmp_path / "a.heic")


def test_what_is_read_is_named(tmp_path: Path):
    for content in (b"nothing", b"GIF89a" + bytes(50), b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom"):
        (tmp_path / "a.jpg").write_bytes(content)
        with pytest.raises(SceneError, match="of no known format; PNG, JPEG, WEBP, BMP, TIFF, AVIF and HEIC are read"):
            read_header(tmp_path / "a.jpg")


def test_an_image_of_too_many_pixels_has_its_own_remedy(tmp_path: Path):
    Image.new("L", (10_000, 9_000)).save(tmp_path / "large.png")
    with pytest.raises(
        SceneError, match=r"large\.png: has 10000x9000 pixels, and images are read up to 89 million; put"
    ):
        read_header(tmp_path / "large.png")


@pytest.mark.parametrize(
    ("name", "options"), [("m.webp", {"lossless": True}), ("m.tif", {"compression": "group4"}), ("m.png", {})]
)
def test_an_even_picture_may_have_few_bytes(name: str, options: dict, tmp_path: Path):
    """As masks are: many pixels and one rectangle."""
    mask = np.zeros((3000, 4000), bool)
    mask[1000:2000, 1000:3000] = True
    picture = Image.fromarray(mask)
    (picture.convert("RGB") if name.endswith("webp") else picture).save(tmp_path / name, **options)
    header = read_header(tmp_path / name)
    assert (header.width, header.height) == (4000, 3000)
    np.testing.assert_array_equal(np.asarray(decoded(tmp_path / name).getchannel("R")) > 0, mask)


@pytest.mark.parametrize("name", ["a.webp", "a.png"])
def test_more_pixels_than_any_bytes_hold_are_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    Image.new("RGB", (600, 500)).save(tmp_path / name, **({"lossless": True} if name == "a.webp" else {}))
    monkeypatch.setattr("ringlight.data.image_files.PIXELS_A_BYTE", 1)
    monkeypatch.setattr("ringlight.data.image_files.PIXELS_A_BYTE_OF", {"WEBP": 1})
    with pytest.raises(SceneError, match="promises 600x500 pixels, more than its bytes can hold"):
        read_header(tmp_path / name)
