"""The photographs: which there are, whether each can be read, what their EXIF says, and where COLMAP finds them.

A photograph gets a hard link in the new scene, or a copy where the disk is another: it is never moved, and deleting the
scene deletes no photograph. A cut-out one gets a mask as well, and a copy over grey, since what is hidden under
transparent pixels is not for its features to see.
"""

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ringlight.data.image_files import decoded, opened, read_header
from ringlight.data.unposed import PHOTOGRAPHS, USUAL_FOLDERS
from ringlight.errors import SceneError
from ringlight.files.atomic import written_atomically

ORIENTATION, MAKE, MODEL = 0x0112, 0x010F, 0x0110
EXIF_FOLDER, FOCAL_LENGTH, FOCAL_LENGTH_35, LENS_MODEL = 0x8769, 0x920A, 0xA405, 0xA434
"""EXIF tags (CIPA DC-008)."""

UNSAFE = re.compile(r"[^\w.+-]+")
"""In names: COLMAP's lists part names by blanks."""

GREY = 128
"""Behind cut-out photographs."""

OPAQUE = 128
"""Least alpha, of 255, of a pixel that shows the subject."""

CONVERTED = frozenset([".heic", ".heif", ".avif"])
"""Suffixes of what COLMAP cannot read: the new scene gets a PNG of it."""

UNREAD = frozenset(["HEIF", "AVIF"])
"""Pillow's names of the same. Many a file that is called a JPEG holds these, or WebP, which COLMAP knows by its suffix
alone; their PNG keeps the name, since PNG is known by its content."""

ENCODED_AS = {".png": "PNG", ".webp": "WEBP", ".tif": "TIFF", ".tiff": "TIFF"}
"""Suffixes of what can be transparent."""


@dataclass(frozen=True)
class Taken:
    """A photograph that can be read. ``name`` is that in the new scene; those with equal ``lens`` share a camera."""

    name: str
    path: Path
    orientation: int
    lens: tuple[str, ...]
    has_exif_camera: bool
    is_cut_out: bool


@dataclass(frozen=True)
class SceneFolders:
    """Below the new scene."""

    scene: Path

    @property
    def images(self) -> Path:
        """What is trained on."""
        return self.scene / "images"

    @property
    def work(self) -> Path:
        """COLMAP's database and whatever else only finding the cameras needs."""
        return self.scene / "poses"

    @property
    def masks(self) -> Path:
        """NAME.png, white where a cut-out photograph shows its subject."""
        return self.work / "masks"

    @property
    def over_grey(self) -> Path:
        """Cut-out photographs without transparency."""
        return self.work / "over-grey"

    @property
    def database(self) -> Path:
        """COLMAP's."""
        return self.work / "database.db"

    @property
    def model(self) -> Path:
        """The largest reconstruction."""
        return self.scene / "sparse" / "0"


def photographs_in(folder: Path) -> list[Path]:
    """The image files of a folder, or of the first of its usual folders that has any, by name.

    Raises:
        SceneError: there are none, or the folder cannot be read.
    """
    try:
        if not folder.is_dir():
            raise SceneError(f"{folder}: no such folder or film; check the path")
        for name in USUAL_FOLDERS:
            here = folder / name
            files = [one for one in here.iterdir() if one.suffix.lower() in PHOTOGRAPHS] if here.is_dir() else []
            if files:
                return sorted(one for one in files if _is_photograph(one))
    except OSError as error:
        raise SceneError(f"{folder}: cannot be read ({error.strerror}); check the path and its permissions") from error
    kinds = " ".join(sorted(PHOTOGRAPHS))
    raise SceneError(f"{folder}: holds no photographs ({kinds}); give the folder that holds them")


def _is_photograph(path: Path) -> bool:
    """A link whose file is gone counts, so that it is among those that cannot be read."""
    return (path.is_file() or (path.is_symlink() and not path.exists())) and not path.name.startswith(".")


def safe_names(paths: Sequence[Path]) -> list[str]:
    """Names for the new scene, in the same order: those of the files, with underscores for blanks and what else a list
    cannot hold; a number tells apart those that become equal."""
    taken: set[str] = set()
    names = []
    for path in paths:
        stem, suffix = UNSAFE.sub("_", path.stem), path.suffix.lower()
        suffix = ".png" if suffix in CONVERTED else suffix
        name, number = stem + suffix, 2
        while name in taken:
            name, number = f"{stem}-{number}{suffix}", number + 1
        taken.add(name)
        names.append(name)
    return names


def take(path: Path, name: str, folders: SceneFolders) -> Taken:
    """Put one photograph where COLMAP finds it; it is decoded first, unless an earlier run has done that.

    Raises:
        SceneError: it is damaged, or of a kind that cannot be trained on.
        OutputError: it cannot be copied.
    """
    header = read_header(path)
    is_cut_out = False
    if header.has_alpha or not (folders.images / name).exists():
        pixels = np.array(decoded(path))
        is_cut_out = pixels.shape[2] == 4 and bool((pixels[..., 3] < OPAQUE).any())
        if is_cut_out:
            _cut_out(pixels, name, folders)
    _place(path, folders.images / name)
    orientation, camera = _exif(folders.images / name)
    lens = (str(header.width), str(header.height), "cut-out" if is_cut_out else "", *camera)
    return Taken(name, path, orientation, lens, any(camera), is_cut_out)


def _place(path: Path, target: Path) -> None:
    """A hard link, or else a copy; a PNG of what COLMAP cannot read."""
    if target.exists():
        return
    with opened(path) as image:
        stored = image.format
    if stored in UNREAD or (stored == "WEBP" and path.suffix.lower() != ".webp"):
        with written_atomically(target) as file:
            decoded(path).save(file, "PNG", exif=_exif_of_png(path, is_turned=stored in UNREAD))
        return
    try:
        os.link(path.resolve(), target)
    except OSError:  # another disk, or one that knows no links
        with path.open("rb") as source, written_atomically(target) as file:
            shutil.copyfileobj(source, file)


def _exif_of_png(path: Path, is_turned: bool) -> bytes:
    """What the photograph's own says, but for the orientation where the decoder has turned it."""
    try:
        with opened(path) as image:
            exif = image.getexif()
        if is_turned:
            exif[ORIENTATION] = 1
        return exif.tobytes()
    except Exception:  # as in :func:`_exif`
        return b""


def _cut_out(pixels: np.ndarray, name: str, folders: SceneFolders) -> None:
    mask = folders.masks / f"{name}.png"
    over_grey = folders.over_grey / name
    alpha = pixels[..., 3:].astype(np.float32) / 255
    flat = (pixels[..., :3] * alpha + GREY * (1 - alpha) + 0.5).astype(np.uint8)
    if not over_grey.exists():
        with written_atomically(over_grey) as file:
            Image.fromarray(flat).save(file, ENCODED_AS.get(over_grey.suffix, "PNG"), lossless=True)
    if not mask.exists():
        with written_atomically(mask) as file:
            Image.fromarray(np.where(pixels[..., 3] >= OPAQUE, 255, 0).astype(np.uint8)).save(file, "PNG")


def _exif(path: Path) -> tuple[int, tuple[str, str, str, str]]:
    """Orientation (1 where nothing is said), and maker, model, lens and focal length as they stand, or empty."""
    try:
        with opened(path) as image:
            exif = image.getexif()
            inner = exif.get_ifd(EXIF_FOLDER)
    except Exception:  # a photograph is good without, and damaged EXIF raises anything
        return 1, ("", "", "", "")
    orientation = exif.get(ORIENTATION, 1)
    focal = inner.get(FOCAL_LENGTH_35) or inner.get(FOCAL_LENGTH) or ""
    words = (exif.get(MAKE, ""), exif.get(MODEL, ""), inner.get(LENS_MODEL, ""), focal)
    maker, model, lens, length = (str(word).strip("\0 ") for word in words)
    return orientation if orientation in range(1, 9) else 1, (maker, model, lens, length)
