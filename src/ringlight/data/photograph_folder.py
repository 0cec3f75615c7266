"""Where the photographs of a COLMAP model lie: the model names them, but not their folder."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ringlight.data.folder import image_inside
from ringlight.data.image_files import read_header
from ringlight.data.masks import USUAL_FOLDER as MASKS
from ringlight.data.options import FOUND, ReadingOptions
from ringlight.errors import SceneError

USUAL_FOLDERS = ("images", "image", "imgs", "rgb", "input", "photos", "frames")
"""Beside ``sparse``, in the order in which they are asked."""

NOT_PHOTOGRAPHS = ("sparse", MASKS)
"""Folders of a workspace that are never looked into."""


@dataclass(frozen=True)
class PhotographFolder:
    """The folder, and by how much its photographs are already divided; ``whole`` is where those of full size lie, if
    they are."""

    path: Path
    divided: int = 1
    whole: Path | None = None

    def refuse_other_size(self, path: Path, name: str, camera: tuple[int, int]) -> None:
        """Raise SceneError where the photograph at ``path`` is not divided as its folder says.

        ``camera`` is the size in pixels of what the model calls ``name``, which counts where there is no photograph of
        full size.
        """
        if self.divided == 1:
            return
        size = _size(path)
        original = image_inside(self.whole, name, str(self.whole)) if self.whole else None
        full = _size(original) if original else camera
        if any(abs(self.divided * side - of) >= self.divided for side, of in zip(size, full, strict=True)):
            raise SceneError(
                f"{path}: has {size[0]}x{size[1]} pixels, which is not {full[0]}x{full[1]} divided by {self.divided}; "
                f"make {self.path.name} again, or move it away to have --downscale shrink the photographs itself"
            )


def photograph_folder(folder: Path, names: Sequence[str], options: ReadingOptions) -> PhotographFolder:
    """The folder that holds the photographs called ``names``: the one asked for, else a usual one, else the only other
    one that holds all. ``images_K`` beside it counts for ``--downscale K``.

    Raises:
        SceneError: there is none, or several might be meant.
    """
    if options.photos != FOUND:
        asked = folder / options.photos if (folder / options.photos).is_dir() else Path(options.photos)
        if not asked.is_dir():
            raise SceneError(f"{asked}: no such folder; give --photos the folder of the photographs")
        return PhotographFolder(asked)
    factor = options.downscale or 1
    resized = [folder / f"{name}_{factor}" for name in USUAL_FOLDERS] if factor > 1 else []
    divided = next((path for path in resized if path.is_dir()), None)
    if divided is not None:
        whole = folder / divided.name.removesuffix(f"_{factor}")
        return PhotographFolder(divided, factor, whole if whole.is_dir() else None)
    return PhotographFolder(_found(folder, names))


def _found(folder: Path, names: Sequence[str]) -> Path:
    usual = [folder / name for name in USUAL_FOLDERS if (folder / name).is_dir()]
    whole = next((path for path in usual if _holds_all(path, names)), None)
    if whole is not None:
        return whole
    shrunk = re.compile(f"({'|'.join(path.name for path in usual)})_[0-9]+")  # not taken unasked, be it complete or not
    inside = [path for path in sorted(folder.iterdir()) if path.is_dir() and path.name not in NOT_PHOTOGRAPHS]
    inside = [path for path in inside if not (usual and shrunk.fullmatch(path.name))]
    holding = [path for path in (folder, *inside) if path not in usual and _holds_all(path, names)]
    if len(holding) > 1:
        both = " and ".join(path.name for path in holding[:2])
        raise SceneError(f"{folder}: {both} both hold the photographs that 'sparse' names; say which by --photos")
    if holding:
        return holding[0]
    if usual:  # whose missing photographs are then named
        return max(usual, key=lambda path: sum(_holds_all(path, [name]) for name in names))
    raise SceneError(
        f"{folder}: no folder 'images' beside 'sparse'; put the photographs there, or name theirs by --photos"
    )


def _holds_all(path: Path, names: Sequence[str]) -> bool:
    return all(image_inside(path, name, str(path)) is not None for name in names)


def _size(path: Path) -> tuple[int, int]:
    header = read_header(path)
    return header.width, header.height
