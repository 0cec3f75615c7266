"""PLY points: every encoding gives the same cloud, and damage is one sentence."""

import struct
import tracemalloc
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene_folders import result_or_sentence

from ringlight.data.ply_points import read_ply_points
from ringlight.errors import SceneError

ROWS = [(0.5, -1.0, 2.0, 255, 0, 51), (1e-3, 7.0, -3.25, 0, 102, 255)]


def header(order: str, count: int = 2, kind: str = "uchar") -> str:
    properties = [f"property float {axis}" for axis in "xyz"] + ["property double nx"]
    properties += [f"property {kind} {name}" for name in ("red", "green", "blue")]
    faces = "element face 0\nproperty list uchar int vertex_indices\n"
    return (
        f"ply\nformat {order} 1.0\ncomment x\nelement vertex {count}\n"
        + "\n".join(properties)
        + f"\n{faces}end_header\n"
    )


def encoded(order: str) -> bytes:
    if order == "ascii":
        return (header(order) + "".join(f"{x} {y} {z} 0 {r} {g} {b}\n" for x, y, z, r, g, b in ROWS)).encode()
    sign = "<" if "little" in order else ">"
    return header(order).encode() + b"".join(struct.pack(f"{sign}3fd3B", x, y, z, 0, *c) for x, y, z, *c in ROWS)


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_every_encoding_is_read(tmp_path: Path, order: str):
    path = tmp_path / "points.ply"
    path.write_bytes(encoded(order))
    cloud = read_ply_points(path)
    assert torch.allclose(cloud.positions, torch.tensor([row[:3] for row in ROWS]))
    assert torch.allclose(cloud.colors, torch.tensor([row[3:] for row in ROWS]) / 255)


def test_colours_may_be_floats_or_missing(tmp_path: Path):
    path = tmp_path / "points.ply"
    path.write_text(header("ascii", 1, "float") + "1 2 3 0 0.25 1.5 nan\n4 5 6 0")
    assert len(read_ply_points(path).positions) == 0
    path.write_text(header("ascii", 1, "float") + "1 2 3 0 0.25 1.5 0\n")
    assert read_ply_points(path).colors.tolist() == [[0.25, 1.0, 0.0]]
    lines = ["ply", "format ascii 1.0", "element vertex 1", *(f"property float {a}" for a in "xyz"), "end_header"]
    path.write_text("\n".join([*lines, "1 2 3"]))
    assert read_ply_points(path).colors.tolist() == [[0.5, 0.5, 0.5]]


def test_a_long_word_takes_no_more_memory_than_its_own(tmp_path: Path):
    path, rows = tmp_path / "points.ply", 100
    lines = [f"0.5{'0' * 100_000} 2 3 0 1 2 3", *["4 5 6 0 1 2 3"] * (rows - 1)]
    path.write_text(header("ascii", rows) + "\n".join(lines))
    tracemalloc.start()
    try:
        positions = read_ply_points(path).positions
        assert tracemalloc.get_traced_memory()[1] < 10 * path.stat().st_size
    finally:
        tracemalloc.stop()
    assert positions[:2].tolist() == [[0.5, 2, 3], [4, 5, 6]]


def test_positions_that_are_not_finite_are_left_out(tmp_path: Path):
    path = tmp_path / "points.ply"
    path.write_text(header("ascii") + "nan 2 3 0 1 2 3\n4 5 6 0 1 2 3\n")
    assert read_ply_points(path).positions.tolist() == [[4, 5, 6]]


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_a_file_cut_anywhere_is_one_sentence(tmp_path: Path, order: str):
    path, whole = tmp_path / "points.ply", encoded(order)
    # The last number of an ascii file may lose its end and still be a number.
    for length in range(len(whole) - (4 if order == "ascii" else 0)):
        path.write_bytes(whole[:length])
        with pytest.raises(SceneError, match=r"points\.ply") as caught:
            read_ply_points(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("count", ["999999999999", "-1", "many", "1e3", "9" * 5000])
@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_an_absurd_count_is_refused(tmp_path: Path, order: str, count: str):
    path = tmp_path / "points.ply"
    path.write_bytes(encoded(order).replace(b"element vertex 2", f"element vertex {count}".encode()))
    with pytest.raises(SceneError):
        read_ply_points(path)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    order=st.sampled_from(["ascii", "binary_little_endian"]),
    place=st.floats(0, 1, exclude_max=True),
    value=st.integers(0, 255),
)
def test_a_damaged_byte_is_a_cloud_or_one_sentence(tmp_path: Path, order: str, place: float, value: int):
    data = bytearray(encoded(order))
    data[int(place * len(data))] = value
    path = tmp_path / "points.ply"
    path.write_bytes(data)
    result = result_or_sentence(lambda: read_ply_points(path))
    if isinstance(result, str):
        assert "\n" not in result
    else:
        assert result.positions.isfinite().all()
        assert ((result.colors >= 0) & (result.colors <= 1)).all()
