"""What COLMAP's database holds, read with the system's SQLite while COLMAP may be writing: names, counts, pairs.

COLMAP's own library is not asked: it lives in another process (:mod:`ringlight.poses.worker`).
"""

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np
from jaxtyping import UInt8

from ringlight.errors import RunError

PAIR_BASE = 2147483647
"""A pair's id is that of its first image times this, plus that of its second (https://colmap.github.io/database.html).
"""


@dataclass(frozen=True)
class Matches:
    """Geometrically verified matches of one photograph: with how many others, and the most with one of them."""

    photographs: int = 0
    most: int = 0


class FeatureDatabase:
    """A database that COLMAP wrote, opened to read; missing files are empty ones."""

    def __init__(self, path: Path):
        self.path = path

    def features(self) -> dict[str, int]:
        """Features of each photograph for which they were sought, by name."""
        rows = self._rows("SELECT images.name, keypoints.rows FROM images JOIN keypoints USING (image_id)")
        return {name: int(count) for name, count in rows}

    def compared(self) -> set[tuple[str, str]]:
        """Pairs that were matched and verified, with or without success; names in order."""
        return {pair for pair, _ in self._verified()}

    def matches(self) -> dict[str, Matches]:
        """Verified matches of each photograph that has any."""
        found: dict[str, Matches] = {}
        for pair, count in self._verified():
            for name in pair if count else ():
                old = found.get(name, Matches())
                found[name] = Matches(old.photographs + 1, max(old.most, count))
        return found

    def descriptors(self, name: str) -> UInt8[np.ndarray, "F 128"]:
        """SIFT descriptors of a photograph."""
        query = "SELECT rows, cols, data FROM descriptors JOIN images USING (image_id) WHERE name = ?"
        rows = self._rows(query, (name,))
        if not rows or not rows[0][0]:
            return np.zeros((0, 128), np.uint8)
        count, width, data = rows[0]
        return np.frombuffer(data, np.uint8).reshape(count, width)

    def _verified(self) -> list[tuple[tuple[str, str], int]]:
        names = dict(self._rows("SELECT image_id, name FROM images"))
        found = []
        for pair, count in self._rows("SELECT pair_id, rows FROM two_view_geometries"):
            first, second = divmod(pair, PAIR_BASE)
            if first in names and second in names:
                one, other = sorted((names[first], names[second]))
                found.append(((one, other), int(count)))
        return found

    def _rows(self, query: str, values: tuple[str, ...] = ()) -> list[tuple]:
        if not self.path.is_file():
            return []
        try:
            with closing(sqlite3.connect(f"file:{quote(str(self.path.resolve()))}?mode=ro", uri=True)) as connection:
                return connection.execute(query, values).fetchall()
        except sqlite3.DatabaseError as error:
            raise RunError(
                f"{self.path}: cannot be read ({error}); delete it, and its features are sought again"
            ) from None
