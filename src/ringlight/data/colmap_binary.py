"""COLMAP's binary model: cameras.bin, images.bin, points3D.bin (little endian, https://colmap.github.io/format.html).

Counts are compared with the size of the file before anything is allocated for them.
"""

import struct
from pathlib import Path

import numpy as np

from ringlight.core.scene import PointCloud
from ringlight.core.words import counted
from ringlight.data.colmap_model import CAMERA_MODELS, ColmapCamera, ColmapImage, cloud_of
from ringlight.data.folder import read_bytes
from ringlight.errors import SceneError

COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<IiQQ")  # id, model, width, height; then the parameters as doubles
IMAGE = struct.Struct("<I7dI")  # id, quaternion wxyz, translation, camera id; then the name and the observations
OBSERVATION_BYTES = 24  # x, y as doubles, point id
POINT = struct.Struct("<Q3d3BdQ")  # id, position, colour, error, length of the track
TRACK_BYTES = 8  # image id, index of the observation


class BinaryFile:
    """A file in memory and the place reached in it; every step is checked against its end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.place = 0

    def take(self, record: struct.Struct) -> tuple:
        """The next record."""
        start = self.place
        self.skip(record.size)
        return record.unpack_from(self.data, start)

    def skip(self, size: int) -> None:
        """Pass over ``size`` bytes; SceneError where the file is shorter."""
        if size > len(self.data) - self.place:
            raise SceneError(
                f"{self.path}: cut after {counted(len(self.data), 'byte')}, within a record; copy the file again"
            )
        self.place += size

    def count(self, smallest: int) -> int:
        """The number of records that follow, each of at least ``smallest`` bytes."""
        (count,) = self.take(COUNT)
        if count * smallest > len(self.data) - self.place:
            raise SceneError(f"{self.path}: promises {counted(count, 'record')} and is too short; copy the file again")
        return count

    def name(self) -> str:
        """Text up to a zero byte."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise SceneError(
                f"{self.path}: cut after {counted(len(self.data), 'byte')}, within a name; copy the file again"
            )
        text = self.data[self.place : end]
        self.place = end + 1
        try:
            return text.decode()
        except UnicodeDecodeError as error:
            raise SceneError(f"{self.path}: the name {text!r} is not UTF-8; rename the image and map again") from error

    def finish(self) -> None:
        """Check that nothing is left."""
        left = len(self.data) - self.place
        if left:
            raise SceneError(
                f"{self.path}: {counted(left, 'byte')} too many behind the last record; copy or export the file again"
            )


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by id; SceneError where the file is damaged or uses a model that is not known."""
    file = BinaryFile(path)
    cameras = {}
    for _ in range(file.count(CAMERA.size)):
        camera_id, number, width, height = file.take(CAMERA)
        model = CAMERA_MODELS.get(number)
        if model is None:
            raise SceneError(f"{path}: camera model number {number} is not known; undistort with colmap first")
        parameters = file.take(struct.Struct(f"<{model.parameters}d"))
        cameras[camera_id] = ColmapCamera(model.name, width, height, parameters)
    file.finish()
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """Registered images, without their observations; SceneError where the file is damaged."""
    file = BinaryFile(path)
    images = []
    for _ in range(file.count(IMAGE.size + 1 + COUNT.size)):
        _, *pose, camera_id = file.take(IMAGE)
        name = file.name()
        file.skip(file.count(OBSERVATION_BYTES) * OBSERVATION_BYTES)
        images.append(ColmapImage(name, camera_id, np.array(pose[:4]), np.array(pose[4:])))
    file.finish()
    return images


def read_points(path: Path) -> PointCloud:
    """Structure-from-motion points; SceneError where the file is damaged."""
    file = BinaryFile(path)
    rows = []
    for _ in range(file.count(POINT.size)):
        _, x, y, z, red, green, blue, _, track = file.take(POINT)
        file.skip(track * TRACK_BYTES)
        rows.append((x, y, z, red, green, blue))
    file.finish()
    return cloud_of(np.array(rows, np.float64).reshape(-1, 6))
