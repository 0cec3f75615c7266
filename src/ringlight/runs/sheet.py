"""A contact sheet on disk."""

from pathlib import Path

from PIL import Image

from ringlight.errors import OutputError
from ringlight.files.atomic import written_atomically


def write_sheet(sheet: Image.Image, path: Path) -> None:
    """Write a PNG, all or nothing, in place of what was there. Raises OutputError."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path}: the picture is a PNG; give a name that ends in .png")
    with written_atomically(path) as file:
        sheet.save(file, "PNG")
