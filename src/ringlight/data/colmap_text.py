"""COLMAP's text model: cameras.txt, images.txt, points3D.txt (https://colmap.github.io/format.html).

Where the comment that COLMAP writes on top states a number of records, a file with another number is refused: text
has no other sign of having been cut.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from ringlight.core.scene import PointCloud
from ringlight.core.words import counted
from ringlight.data.colmap_model import ColmapCamera, ColmapImage, cloud_of
from ringlight.data.folder import read_bytes
from ringlight.errors import SceneError

STATED_COUNT = re.compile(r"^#\s*Number of (?:cameras|images|points):\s*(\d{1,18})\b", re.MULTILINE)

Record = TypeVar("Record")


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by id; SceneError where a line cannot be read."""
    return dict(_records(path, _camera))


def read_images(path: Path) -> list[ColmapImage]:
    """Registered images, without their observations; SceneError where a line cannot be read."""
    return _records(path, _image, lines_each=2)


def read_points(path: Path) -> PointCloud:
    """Structure-from-motion points; SceneError where a line cannot be read."""
    return cloud_of(np.array(_records(path, _point), np.float64).reshape(-1, 6))


def _camera(line: str) -> tuple[int, ColmapCamera]:
    camera_id, model, width, height, *parameters = line.split()
    return int(camera_id), ColmapCamera(model, int(width), int(height), tuple(map(float, parameters)))


def _image(line: str) -> ColmapImage:
    _, *pose, camera_id, name = line.split(maxsplit=9)
    numbers = np.array([float(word) for word in pose])
    if len(numbers) != 7:
        raise ValueError("a pose of other than seven numbers")
    return ColmapImage(name.strip(), int(camera_id), numbers[:4], numbers[4:])


def _point(line: str) -> tuple[float, ...]:
    words = line.split(maxsplit=8)
    if len(words) < 8:
        raise ValueError("a point of fewer than eight numbers")
    return tuple(float(word) for word in words[1:7])


def _records(path: Path, parse: Callable[[str], Record], lines_each: int = 1) -> list[Record]:
    """Every record's first line, parsed; the lines after it (observations, which may be empty) are passed over."""
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text file in UTF-8; copy or export the file again") from error
    records: list[Record] = []
    pass_over = 0
    for number, line in enumerate(text.split("\n"), start=1):
        if pass_over:
            pass_over -= 1
        elif line.strip() and not line.startswith("#"):
            try:
                records.append(parse(line))
            except (ValueError, OverflowError) as error:
                where, shown = f"{path}, line {number}", line[:60].strip()
                raise SceneError(f"{where}: cannot be read ({shown!r}); copy or export the file again") from error
            pass_over = lines_each - 1
    stated = STATED_COUNT.search(text)
    if stated is not None and int(stated[1]) != len(records):
        raise SceneError(
            f"{path}: says that it holds {counted(int(stated[1]), 'record')} but holds {len(records)}; copy it again"
        )
    return records
