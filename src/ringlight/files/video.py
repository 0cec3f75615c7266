"""Pictures that leave the program: one image, or an H.264 film."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from io import BytesIO
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from ringlight.errors import BackendError, OutputError
from ringlight.files.atomic import written_atomically

IMAGE_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}

QUALITY: dict[str, dict[str, Any]] = {"JPEG": {"quality": 95, "subsampling": 0}, "WEBP": {"lossless": True}, "PNG": {}}
"""Encoder settings: what cannot be lossless is without visible loss."""

CONSTANT_RATE_FACTOR = "17"
"""x264's quality, 0 to 51; 17 is held to be visually lossless."""

BT709 = 1
"""The colour matrix and primaries of HD video, in the numbering of ITU-T H.273; players assume it."""

LIMITED_RANGE = 1
"""Luma from 16 to 235, FFmpeg's AVCOL_RANGE_MPEG: what players assume of yuv420p."""


def to_8bit(image: Float[Tensor, "H W c"]) -> UInt8[np.ndarray, "H W c"]:
    """Clamped to [0, 1], rounded to the nearest of 256 levels; what is not a number becomes black."""
    levels = torch.nan_to_num(image.detach(), nan=0.0, posinf=1.0, neginf=0.0).clamp(0, 1) * 255
    return levels.round().to(torch.uint8).cpu().contiguous().numpy()


def save_image(path: Path, image: Float[Tensor, "H W c"]) -> None:
    """Write an 8-bit image of 1 or 3 channels in [0, 1], all or nothing; the suffix names the format.

    Raises OutputError.
    """
    save_8bit(path, to_8bit(image))


def save_8bit(path: Path, pixels: UInt8[np.ndarray, "H W c"]) -> None:
    """The same of an image that is one of bytes already. Raises OutputError."""
    kind = IMAGE_FORMATS.get(path.suffix.lower())
    if kind is None:
        known = ", ".join(IMAGE_FORMATS)
        raise OutputError(f"{path}: cannot be written: unknown kind of picture; end its name in one of {known}")
    with written_atomically(path) as file:
        Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels).save(file, kind, **QUALITY[kind])


def write_video(path: Path, frames: Iterable[Float[Tensor, "H W 3"]], fps: float) -> None:
    """An mp4 (H.264, yuv420p, plays everywhere), all or nothing.

    Frames of one size, at least one, consumed one at a time; an odd side is padded by repeating the last row or
    column, because yuv420p shares colour between two. Raises OutputError, and BackendError without the video extra.
    """
    library = video_library()
    pictures = (_even(to_8bit(frame)) for frame in frames)
    first = next(pictures, None)
    if first is None:
        raise OutputError(f"{path}: cannot be written: the film has no frames; give at least one")
    with written_atomically(path) as file:
        file.write(_encoded(library, _of_one_size(path, chain([first], pictures), first.shape), first.shape, fps))


def video_library() -> ModuleType:
    """PyAV, which writes films. Raises BackendError where the video extra is not installed."""
    try:
        import av
    except ImportError as error:
        raise BackendError('films need the video extra: pip install "ringlight[video]", or write PNG frames') from error
    return av


def _even(pixels: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
    height, width = pixels.shape[:2]
    return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def _of_one_size(
    path: Path, pictures: Iterable[UInt8[np.ndarray, "H W 3"]], shape: tuple[int, ...]
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    for picture in pictures:
        if picture.shape != shape:
            raise OutputError(f"{path}: cannot be written: the frames of a film must have one size; scale them alike")
        yield picture


def _encoded(
    av: ModuleType, pictures: Iterable[UInt8[np.ndarray, "H W 3"]], shape: tuple[int, ...], fps: float
) -> memoryview:
    """The film's bytes. In memory, because PyAV prints and drops errors of a file it writes to."""
    rate = Fraction(fps).limit_denominator(1001)
    file = BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": CONSTANT_RATE_FACTOR, "preset": "medium"})
        stream.height, stream.width, stream.pix_fmt = shape[0], shape[1], "yuv420p"
        stream.codec_context.colorspace = stream.codec_context.color_primaries = BT709
        stream.codec_context.color_trc = BT709
        stream.codec_context.color_range = LIMITED_RANGE
        for pixels in pictures:
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace=BT709, dst_color_range=LIMITED_RANGE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return file.getbuffer()
