"""Photographs of a film: the sharpest frames between which the picture has moved enough to show another side."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from ringlight.core.words import counted
from ringlight.errors import SceneError
from ringlight.files.atomic import written_atomically
from ringlight.files.video import video_library
from ringlight.poses.photographs import safe_names

WIDTH = 320
"""At which motion and sharpness are measured, pixels."""

BLOCK = 32
"""Side of the squares whose motion is followed, pixels: a motion of a third of it between two frames is found."""

MOVED = 0.05
"""Share of the width by which the middle block has moved from one photograph to the next: at 60 degrees of view three
degrees of a turn, well within what SIFT matches, and 120 photographs of a walk around something."""

LOOK_AROUND = 0.4
"""Share of :data:`MOVED` before and after it within which the sharpest frame is taken."""

PLAIN = 2.0
"""Standard deviation in grey levels of a block below which its motion cannot be seen."""

FEWEST_BLOCKS = 4
"""That show something, without which a frame shows nothing to follow."""

FEWEST_FRAMES = 3
"""From which cameras can be found."""

JPEG_QUALITY = 95

TURNS = {90: Image.Transpose.ROTATE_90, 180: Image.Transpose.ROTATE_180, 270: Image.Transpose.ROTATE_270}
"""By degrees, counter-clockwise like those of a frame's display matrix."""


@dataclass(frozen=True)
class Look:
    """What one frame says. ``moved`` is how far the middle block came since the first frame, in shares of the width,
    summed over the steps of the path that it follows; ``sharpness`` the variance of the Laplacian."""

    index: int
    moved: float
    sharpness: float


def take_frames(film: Path, images: Path, most: int, tell: Callable[[int, int], None]) -> list[str]:
    """Write the chosen frames of a film as JPEG into ``images``; returns their names.

    Raises:
        SceneError: not a film, one that shows nothing, or one that does not move.
        BackendError: the video extra is not installed.
    """
    looks = list(_looks(film, tell))
    chosen = choose(looks, most)
    if len(chosen) < FEWEST_FRAMES:
        raise SceneError(f"{film}: {_why_too_few(looks)}; film again, walking slowly around the subject in good light")
    names = dict(zip(chosen, safe_names([Path(f"{film.stem}-{index:06d}.jpg") for index in chosen]), strict=True))
    for index, frame in enumerate(_frames(film)):
        if index in names and not (images / names[index]).exists():
            with written_atomically(images / names[index]) as file:
                _as_held(frame).save(file, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return list(names.values())


def _as_held(frame: Any) -> Image.Image:
    """Turned as the film says to show it: telephones store upright films lying, and up is sought in these pictures."""
    picture: Image.Image = frame.to_image()
    turn = TURNS.get(round(getattr(frame, "rotation", 0)) % 360)  # older versions of PyAV do not tell
    return picture if turn is None else picture.transpose(turn)


def choose(looks: list[Look], most: int) -> list[int]:
    """Indices of the frames to take, at most ``most``: each :data:`MOVED` from the last, or as far as it must be to get
    along with that many, and within reach of that place the sharpest."""
    if not looks:
        return []
    whole = looks[-1].moved
    step = max(MOVED, whole / max(most - 1, 1))
    reach = LOOK_AROUND * step
    chosen = []
    for place in np.arange(0, whole + step / 2, step):
        near = [look for look in looks if abs(look.moved - place) <= reach]
        if near:
            chosen.append(max(near, key=lambda look: look.sharpness).index)
    return chosen[:most]


def _looks(film: Path, tell: Callable[[int, int], None]) -> Iterator[Look]:
    before: Float[np.ndarray, "H W"] | None = None
    drift: Float[np.ndarray, "B 2"] | float = 0.0
    moved = now = 0.0
    for index, frame in enumerate(_frames(film)):
        height = max(BLOCK, round(WIDTH * frame.height / frame.width))
        grey = frame.reformat(WIDTH, height, "gray").to_ndarray().astype(np.float32)
        if before is not None:
            drift = drift + block_motion(before, grey)
            now = _middle_length(drift)
            if now > LOOK_AROUND * MOVED:  # short enough that blocks still show the same, long enough to cancel shaking
                moved, drift, now = moved + now, 0.0, 0.0
        yield Look(index, moved + now, sharpness(grey))
        before = grey
        tell(index + 1, 0)


def _middle_length(drift: Float[np.ndarray, "B 2"]) -> float:
    """In shares of the width; of blocks that showed something all the while."""
    lengths = np.linalg.norm(drift, axis=1)
    seen = lengths[np.isfinite(lengths)]
    return float(np.median(seen)) / WIDTH if len(seen) >= FEWEST_BLOCKS else 0.0


def block_motion(before: Float[np.ndarray, "H W"], now: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "B 2"]:
    """How far each block came from one grey picture to the next, pixels down and right, by phase correlation (Kuglin
    and Hines, "The phase correlation image alignment method", 1975); NaN for a block that shows nothing."""
    ours, theirs = _blocks(before), _blocks(now)
    window = np.outer(np.hanning(BLOCK), np.hanning(BLOCK))
    spectra = [np.fft.rfft2((one - one.mean((1, 2), keepdims=True)) * window) for one in (ours, theirs)]
    cross = np.conj(spectra[0]) * spectra[1]
    peaks = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-6), s=(BLOCK, BLOCK)).reshape(len(ours), -1).argmax(1)
    motion = np.stack(np.divmod(peaks, BLOCK), 1).astype(float)
    motion[motion > BLOCK / 2] -= BLOCK
    motion[(ours.std((1, 2)) <= PLAIN) | (theirs.std((1, 2)) <= PLAIN)] = np.nan
    return motion


def sharpness(grey: Float[np.ndarray, "H W"]) -> float:
    """Variance of the Laplacian: edges are what blur takes first."""
    inner = grey[1:-1, 1:-1]
    laplacian = grey[:-2, 1:-1] + grey[2:, 1:-1] + grey[1:-1, :-2] + grey[1:-1, 2:] - 4 * inner
    return float(laplacian.var())


def _blocks(grey: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "B s s"]:
    down, across = grey.shape[0] // BLOCK, grey.shape[1] // BLOCK
    cut = grey[: down * BLOCK, : across * BLOCK].reshape(down, BLOCK, across, BLOCK)
    return cut.transpose(0, 2, 1, 3).reshape(-1, BLOCK, BLOCK)


def _why_too_few(looks: list[Look]) -> str:
    if not looks:
        return "has no frames"
    if max(look.sharpness for look in looks) < PLAIN:
        return f"shows nothing in any of its {counted(len(looks), 'frame')}"
    if len(looks) == 1:
        return "has a single frame"
    return f"hardly moves in its {len(looks)} frames, so that no two of them show the subject from different sides"


def _frames(film: Path) -> Iterator:
    library = video_library()
    try:
        with library.open(str(film)) as container:
            if not container.streams.video:
                raise SceneError(f"{film}: has no pictures; give a film")
            yield from container.decode(container.streams.video[0])
    except (library.FFmpegError, OSError) as error:
        raise SceneError(
            f"{film}: cannot be read as a film ({error.strerror or error}); copy the file again"
        ) from error
