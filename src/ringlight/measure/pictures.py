"""Pictures of test views, read from a run folder: one 8-bit PNG per view, decoded when they are looked at."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from ringlight.core.command_line import command
from ringlight.core.lost_disk import what_helps
from ringlight.errors import RunError
from ringlight.measure.picture_names import picture_name

MAX_PIXELS = 100_000_000
"""No camera of today makes larger pictures; a file that claims more is not decoded."""


def read_picture(path: Path) -> Float[Tensor, "H W 3"]:
    """A picture in [0, 1]. Raises RunError as :func:`read_pixels`."""
    return torch.from_numpy(read_pixels(path)).float().div_(255)


def read_pixels(path: Path) -> UInt8[np.ndarray, "H W 3"]:
    """A picture as its file has it.

    Raises:
        RunError: the file is missing, damaged, or absurdly large.
    """
    try:
        with Image.open(path, formats=["PNG"]) as picture:
            if picture.width * picture.height > MAX_PIXELS:
                raise RunError(f"{path}: {picture.width}x{picture.height} is no test picture; {_remedy(path)}")
            return np.array(picture.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise RunError(f"{path}: cannot be read as a picture ({error}); {_remedy(path)}") from None


def same_picture(one: Path, other: Path) -> bool:
    """Whether two files hold the same pixels.

    Raises:
        RunError: a file is missing or damaged.
    """
    try:
        # Fast, and enough where one version of the encoder wrote both.
        if one.read_bytes() == other.read_bytes():
            return True
    except OSError as error:
        raise RunError(
            f"{error.filename}: cannot be read ({error.strerror}); {what_helps(error, _remedy(one))}"
        ) from None
    return torch.equal(read_picture(one), read_picture(other))


def _remedy(path: Path) -> str:
    # RUN/images/test/VIEW.png
    return f"make it again with: {command('eval', path.parents[2])}"


class PictureFolder:
    """Pictures of one folder by the name of their view, decoded at each access; only those that exist."""

    def __init__(self, folder: Path, views: Iterable[str]) -> None:
        paths = {view: folder / picture_name(view) for view in views}
        self.paths = {view: path for view, path in paths.items() if path.is_file()}

    def __getitem__(self, view: str) -> Float[Tensor, "H W 3"]:
        """The picture in [0, 1]; raises RunError if its file is damaged."""
        return read_picture(self.paths[view])

    def __iter__(self) -> Iterator[str]:
        return iter(self.paths)

    def __contains__(self, view: object) -> bool:
        return view in self.paths

    def __len__(self) -> int:
        return len(self.paths)
