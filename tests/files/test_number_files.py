"""Layers as numbers, read back by others: NumPy, FFmpeg's PNG, OpenEXR's own library."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from ringlight.errors import OutputError
from ringlight.files.number_files import TOP, Scale, png16, scale_of, write_numbers

VALUES = torch.rand(7, 11, 3, generator=torch.Generator().manual_seed(1)) * 2 - 1
DEPTH = torch.rand(7, 11, 1, generator=torch.Generator().manual_seed(2)) * 9
UNIT = Scale(0.0, 1.0)


def test_npy_keeps_every_bit(tmp_path: Path) -> None:
    write_numbers(tmp_path / "a.npy", "normal", VALUES, UNIT)
    write_numbers(tmp_path / "d.npy", "depth", DEPTH, UNIT)
    found = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert found.dtype == np.float32
    assert np.array_equal(found, VALUES.numpy())
    assert np.load(tmp_path / "d.npy", allow_pickle=False).shape == (7, 11)


def by_ffmpeg(path: Path, pixels: str) -> np.ndarray:
    av = pytest.importorskip("av")
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        assert frame.format.name == pixels, "sixteen bits, big end first"
        return frame.to_ndarray().astype(int)


@settings(max_examples=20, deadline=None)
@given(arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3]))))
def test_png_of_16_bits_is_read_by_ffmpeg(tmp_path_factory, stored: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("png") / "x.png"
    path.write_bytes(png16(stored))
    found = by_ffmpeg(path, "gray16be" if stored.shape[2] == 1 else "rgb48be")
    assert np.array_equal(found.reshape(stored.shape), stored)
    if stored.shape[2] == 1:
        with Image.open(path) as picture:
            picture.load()
            assert np.array_equal(np.array(picture).astype(int), stored[..., 0])


@pytest.mark.parametrize("layer", ["normal", "residual", "color", "depth"])
def test_numbers_come_back_from_16_bits(layer: str, tmp_path: Path) -> None:
    values = DEPTH if layer == "depth" else VALUES if layer in ("normal", "residual") else (VALUES + 1) / 2
    scale = scale_of(layer, 10.0)
    write_numbers(tmp_path / "x.png", layer, values, scale)
    stored = by_ffmpeg(tmp_path / "x.png", "gray16be" if layer == "depth" else "rgb48be").reshape(values.shape)
    assert abs(scale.low + stored * scale.step - values.numpy()).max() <= 0.51 * scale.step


def test_what_16_bits_cannot_hold_is_the_nearest_that_they_can(tmp_path: Path) -> None:
    values = torch.tensor([[[-1.0], [0.5], [7.0], [float("nan")]]])
    write_numbers(tmp_path / "x.png", "alpha", values, scale_of("alpha", 1.0))
    with Image.open(tmp_path / "x.png") as picture:
        assert np.array(picture).astype(int).tolist() == [[0, 32768, TOP, 0]]


@pytest.mark.parametrize(
    ("layer", "values", "names"),
    [("normal", VALUES, ["N.X", "N.Y", "N.Z"]), ("color", VALUES, ["B", "G", "R"]), ("depth", DEPTH, ["Z"])],
)
def test_exr_holds_the_numbers_by_their_usual_names(
    layer: str, values: torch.Tensor, names: list[str], tmp_path: Path
) -> None:
    library = pytest.importorskip("OpenEXR")
    write_numbers(tmp_path / "x.exr", layer, values, UNIT)
    with library.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
        channels = file.channels()
        assert sorted(channels) == names
        for index, name in enumerate(["R", "G", "B"] if layer == "color" else names):
            assert channels[name].pixels.dtype == np.float32
            assert np.array_equal(channels[name].pixels, values[..., index].numpy())


def test_a_folder_that_is_gone_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="create it first"):
        write_numbers(tmp_path / "gone" / "x.npy", "depth", DEPTH, UNIT)


def test_exr_is_written_beside_its_target_and_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = pytest.importorskip("OpenEXR")
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    target = tmp_path / "x.exr"
    write_numbers(target, "depth", DEPTH, UNIT)
    before = target.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["x.exr"]

    class Full:
        ZIP_COMPRESSION, scanlineimage = library.ZIP_COMPRESSION, library.scanlineimage

        class File:
            def __init__(self, *_: object) -> None: ...

            def write(self, name: str) -> None:
                Path(name).write_bytes(b"half")
                raise RuntimeError("no space")

    monkeypatch.setattr("ringlight.files.number_files.exr_library", lambda: Full)
    with pytest.raises(OutputError, match=r"x\.exr: cannot be written.*no space"):
        write_numbers(target, "depth", 2 * DEPTH, UNIT)
    assert target.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["x.exr"]
