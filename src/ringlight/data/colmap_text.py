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
from ringlight.data.folder import MOST_SHOWN, read_bytes
from ringlight.errors import SceneError

STATED_COUNT = re.compile(r"^[ \t]*#\s*Number of (?:cameras|images|points):\s*(\d{1,18})\b", re.MULTILINE)

OBSERVATION_WORDS = 3
"""x, y in pixels, point id."""

EMPTY_LINES = "put an empty line after that of each image without observations, or export the file again"

Record = TypeVar("Record")


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by id; SceneError where a line cannot be read."""
    return dict(_records(path, _camera))


def read_images(path: Path) -> list[ColmapImage]:
    """Registered images, without their observations; SceneError where a line cannot be read."""
    return _records(path, _image, has_observations=True)


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


def _records(path: Path, parse: Callable[[str], Record], has_observations: bool = False) -> list[Record]:
    """Every record's line, parsed; the line after each is passed over where it lists observations, or none."""
    try:
        text = read_bytes(path).decode("utf-8-sig")  # some programs put a mark before the first byte
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text file in UTF-8; copy or export the file again") from error
    records: list[Record] = []
    passes_over = False
    for number, line in enumerate(text.split("\n"), start=1):
        if passes_over:
            passes_over = False
            if not _lists_observations(line):
                problem = "stands in place of the observations of the image before"
                raise _refusal(path, number, line, problem, EMPTY_LINES)
        elif line.strip() and not line.lstrip().startswith("#"):
            try:
                records.append(parse(line))
            except (ValueError, OverflowError) as error:
                raise _refusal(path, number, line, "cannot be read", "copy or export the file again") from error
            passes_over = has_observations
    stated = STATED_COUNT.search(text)
    if stated is not None and int(stated[1]) != len(records):
        raise SceneError(
            f"{path}: says that it holds {counted(int(stated[1]), 'record')} but holds {len(records)}; copy it again"
        )
    return records


def _refusal(path: Path, number: int, line: str, problem: str, remedy: str) -> SceneError:
    return SceneError(f"{path}, line {number}: {problem} ({line[:MOST_SHOWN].strip()!r}); {remedy}")


def _lists_observations(line: str) -> bool:
    """Whether it holds x, y and point id, any number of times. An image's line may have as many words, but those of its
    name are not all numbers: photographs have a suffix."""
    words = line.split()
    try:
        for word in words:
            float(word)
    except ValueError:
        return False
    return len(words) % OBSERVATION_WORDS == 0
