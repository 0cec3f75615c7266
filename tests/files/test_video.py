"""Pictures are exact to a level, films to a few; both appear complete or not at all."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from ringlight.errors import BackendError, OutputError
from ringlight.files.video import save_image, to_8bit, write_video


def random_image(height: int, width: int, channels: int = 3) -> torch.Tensor:
    return torch.rand(height, width, channels, generator=torch.Generator().manual_seed(3))


def colored_frames(count: int, height: int, width: int) -> list[torch.Tensor]:
    return [torch.tensor([i / count, 0.5, 1 - i / count]).expand(height, width, 3) for i in range(count)]


def test_levels_are_rounded_and_clamped() -> None:
    values = torch.tensor([-1.0, 0.0, 0.4999 / 255, 0.5001 / 255, 1.0, 7.0, float("nan"), float("inf")])
    assert to_8bit(values[None, :, None])[0, :, 0].tolist() == [0, 0, 0, 1, 255, 255, 0, 255]


@pytest.mark.parametrize(("suffix", "tolerance"), [(".png", 0), (".webp", 0), (".jpg", 40)])
@pytest.mark.parametrize("channels", [1, 3])
def test_an_image_comes_back(tmp_path: Path, suffix: str, tolerance: int, channels: int) -> None:
    image = random_image(9, 16, channels)
    save_image(tmp_path / f"a{suffix}", image)
    with Image.open(tmp_path / f"a{suffix}") as file:
        found = np.asarray(file.convert("RGB"))
    assert np.abs(found.astype(int) - np.broadcast_to(to_8bit(image), found.shape)).max() <= tolerance


def test_an_unknown_suffix_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"end its name in one of \.png"):
        save_image(tmp_path / "a.tiff", random_image(2, 2))


def test_a_film_plays_back(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="films need the video extra")
    frames = colored_frames(8, 33, 47)
    write_video(tmp_path / "a.mp4", iter(frames), 24.0)
    with av.open(tmp_path / "a.mp4") as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt, stream.average_rate) == ("h264", "yuv420p", 24)
        decoded = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert [picture.shape for picture in decoded] == [(34, 48, 3)] * 8
    for picture, frame in zip(decoded, frames, strict=True):
        # Limited-range yuv420p cannot hold every colour to the level.
        assert np.abs(picture[:33, :47].astype(int) - to_8bit(frame)).max() <= 4


def test_a_film_that_breaks_off_leaves_the_old_one(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="films need the video extra")
    (tmp_path / "a.mp4").write_bytes(b"old")

    def breaking() -> Iterator[torch.Tensor]:
        yield from colored_frames(3, 32, 32)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / "a.mp4", breaking(), 30.0)
    assert (tmp_path / "a.mp4").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_a_film_on_a_full_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("av", reason="films need the video extra")
    resource = pytest.importorskip("resource", reason="limits on file size are a Unix notion")
    noise = list(random_image(64, 12 * 64).unfold(1, 64, 64).permute(1, 0, 3, 2))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # compiled modules would be cut off at the limit
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(OutputError, match="cannot be written"):
            write_video(tmp_path / "a.mp4", noise, 30.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


def test_a_film_of_two_sizes_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="films need the video extra")
    with pytest.raises(OutputError, match=r"a\.mp4: cannot be written: .* one size"):
        write_video(tmp_path / "a.mp4", iter([random_image(8, 8), random_image(8, 10)]), 30.0)
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_the_pip_line_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(BackendError, match=r'pip install "ringlight\[video\]"'):
        write_video(tmp_path / "a.mp4", colored_frames(1, 4, 4), 30.0)
