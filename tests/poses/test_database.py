"""COLMAP's database, read without COLMAP."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from ringlight.errors import RunError
from ringlight.poses.database import PAIR_BASE, FeatureDatabase, Matches

TABLES = """
CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);
CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE descriptors (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER, rows INTEGER, cols INTEGER, data BLOB, config INTEGER);
"""


def written(path: Path) -> FeatureDatabase:
    descriptors = np.arange(256, dtype=np.uint8)
    with closing(sqlite3.connect(path)) as base:
        base.executescript(TABLES)
        base.executemany("INSERT INTO images VALUES (?, ?, 1)", [(1, "b"), (2, "a"), (3, "c")])
        base.executemany("INSERT INTO keypoints VALUES (?, ?, 6, x'')", [(1, 2), (2, 70)])
        base.execute("INSERT INTO descriptors VALUES (1, 2, 128, ?)", (descriptors.tobytes(),))
        pairs = [(PAIR_BASE + 2, 40), (PAIR_BASE + 3, 0), (2 * PAIR_BASE + 3, 15)]
        base.executemany("INSERT INTO two_view_geometries VALUES (?, ?, 2, x'', 2)", pairs)
        base.commit()
    return FeatureDatabase(path)


def test_what_it_says(tmp_path: Path):
    base = written(tmp_path / "a database?#.db")
    assert base.features() == {"b": 2, "a": 70}
    assert base.compared() == {("a", "b"), ("b", "c"), ("a", "c")}
    assert base.matches() == {"a": Matches(2, 40), "b": Matches(1, 40), "c": Matches(1, 15)}
    np.testing.assert_array_equal(base.descriptors("b"), np.arange(256, dtype=np.uint8).reshape(2, 128))
    assert base.descriptors("c").shape == (0, 128)


def test_no_database_is_an_empty_one(tmp_path: Path):
    base = FeatureDatabase(tmp_path / "none.db")
    assert (base.features(), base.compared(), base.matches()) == ({}, set(), {})
    assert not (tmp_path / "none.db").exists()


def test_a_damaged_one_is_a_sentence(tmp_path: Path):
    (tmp_path / "bad.db").write_bytes(b"SQLite format 3\0" + b"x" * 5000)
    with pytest.raises(RunError, match=r"bad\.db: cannot be read"):
        FeatureDatabase(tmp_path / "bad.db").features()
