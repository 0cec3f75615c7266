"""Which files are images: PNG, JPEG, WebP, BMP and TIFF by Pillow, AVIF and HEIC where the extra ``photos`` is there.

Photographs are decoded by several threads. So Pillow's own way to open files is not taken: it warns of many pixels, and
to hear a warning one has to change filters that all threads share.
"""

import struct
from importlib import import_module
from pathlib import Path

from PIL import Image, UnidentifiedImageError, features

from ringlight.errors import SceneError

PLUGINS = {
    "PNG": "PngImagePlugin",
    "JPEG": "JpegImagePlugin",
    "WEBP": "WebPImagePlugin",
    "BMP": "BmpImagePlugin",
    "TIFF": "TiffImagePlugin",
}
"""What photographs come as, and the part of Pillow that reads it; Pillow knows others, one of which runs a program to
be read."""

KNOWN = ", ".join([*PLUGINS, "AVIF and HEIC"])
"""For a sentence."""

NOT_THIS_FORMAT = (SyntaxError, IndexError, TypeError, struct.error)
"""What a plugin raises that finds a file to be none of its format."""

BEGINNING = 64
"""Bytes by which formats are known; AVIF and HEIC have a list of brands there."""

HEIC_BRANDS = frozenset([b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"])
HEIF_READERS = ("pi_heif", "pillow_heif")
"""The first one is what the extra brings; it only decodes."""


def identified(path: Path) -> Image.Image:
    """The image, not decoded yet. Raises UnidentifiedImageError, OSError, or SceneError where the format's reader is
    not installed."""
    with path.open("rb") as file:
        beginning = file.read(BEGINNING)
    if beginning[4:8] == b"ftyp":
        return _of_media(path, beginning)
    for name, plugin in PLUGINS.items():
        import_module(f"PIL.{plugin}")
        open_file, accepts = Image.OPEN[name]
        if accepts is None or accepts(beginning):
            try:
                if name == "TIFF":
                    return _tiff(path)
                return open_file(str(path), str(path))  # type: ignore[arg-type]  # which opens and closes it
            except NOT_THIS_FORMAT:
                continue
    raise UnidentifiedImageError


def _tiff(path: Path) -> Image.Image:
    from ringlight.data.stored_tiff import StoredTiff

    return StoredTiff(str(path), str(path))


def _of_media(path: Path, beginning: bytes) -> Image.Image:
    """An AVIF or HEIC image; a film begins alike."""
    (length,) = struct.unpack(">I", beginning[:4])
    brands = {beginning[place : place + 4] for place in range(8, min(length, BEGINNING), 4)}
    try:
        if b"avif" in brands:
            return _avif(path)
        if brands & HEIC_BRANDS:
            return _heic(path)
    except NOT_THIS_FORMAT as error:
        raise UnidentifiedImageError from error
    raise UnidentifiedImageError


def _avif(path: Path) -> Image.Image:
    if not features.check("avif"):  # Pillow before 11.3
        raise _needs_extra(path, "AVIF")
    from PIL.AvifImagePlugin import AvifImageFile

    return AvifImageFile(str(path), str(path))


def _heic(path: Path) -> Image.Image:
    for module in HEIF_READERS:
        try:
            reader = import_module(module)
        except ImportError:
            continue
        image: Image.Image = reader.HeifImageFile(str(path), str(path))
        return image
    raise _needs_extra(path, "HEIC")


def _needs_extra(path: Path, name: str) -> SceneError:
    return SceneError(f"{path}: is a photograph in {name}, which needs an extra: pip install 'ringlight[photos]'")
