"""The viewers' format: what is written is read back, by us and by third-party parsers; damage is named."""

import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.gaussians import Gaussians
from ringlight.errors import ModelFileError
from ringlight.files.ply import GaussianPly, read_gaussian_ply, write_gaussian_ply


def random_model(rows: int, coefficients: int, seed: int = 0) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return Gaussians(
        means=random(rows, 3),
        log_scales=random(rows, 3) - 3,
        quats=torch.nn.functional.normalize(random(rows, 4), dim=-1),
        opacity_logits=random(rows),
        appearance={"sh_dc": random(rows, 3), "sh_rest": random(rows, coefficients, 3)},
    )


def write(path: Path, model: Gaussians, antialiased: bool = False, comments: tuple[str, ...] = ()) -> None:
    appearance = model.appearance
    write_gaussian_ply(path, model, appearance["sh_dc"], appearance["sh_rest"], antialiased, comments)


def assert_equal(found: GaussianPly, model: Gaussians) -> None:
    columns = found.gaussians.columns()
    assert columns.keys() == model.columns().keys()
    for name, column in model.columns().items():
        # Rotations are normalized once more when they are written, which may move the last bit.
        torch.testing.assert_close(columns[name], column, rtol=2e-7, atol=1e-7 if name == "quats" else 0)


@settings(max_examples=25)
@given(rows=st.integers(0, 40), coefficients=st.sampled_from([0, 3, 8, 15]), antialiased=st.booleans())
def test_write_then_read_gives_the_same(
    tmp_path_factory: pytest.TempPathFactory, rows: int, coefficients: int, antialiased: bool
) -> None:
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    model = random_model(rows, coefficients)
    write(path, model, antialiased, ("made by a test\nin two lines", "größer"))
    found = read_gaussian_ply(path)
    assert found.antialiased == antialiased
    assert_equal(found, model)


def test_more_rows_than_a_chunk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["ringlight.files.ply"], "CHUNK_ROWS", 7)
    model = random_model(30, 15)
    write(tmp_path / "a.ply", model)
    assert_equal(read_gaussian_ply(tmp_path / "a.ply"), model)


def test_rotations_are_written_with_unit_length(tmp_path: Path) -> None:
    model = random_model(5, 0)
    longer = Gaussians.from_columns(model.columns() | {"quats": model.quats * 3})
    write(tmp_path / "a.ply", longer)
    torch.testing.assert_close(read_gaussian_ply(tmp_path / "a.ply").gaussians.quats, model.quats)


def test_gsply_agrees_on_every_column(tmp_path: Path) -> None:
    gsply = pytest.importorskip("gsply", reason="the third-party parser gsply is in the dev extra")
    model = random_model(11, 15)
    write(tmp_path / "a.ply", model, antialiased=True, comments=("a comment",))
    theirs = gsply.plyread(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(theirs.means, model.means)
    np.testing.assert_array_equal(theirs.scales, model.log_scales)
    np.testing.assert_array_equal(theirs.opacities, model.opacity_logits)
    np.testing.assert_array_equal(theirs.sh0, model.appearance["sh_dc"])
    np.testing.assert_array_equal(theirs.shN, model.appearance["sh_rest"])
    np.testing.assert_allclose(theirs.quats, model.quats, rtol=2e-7, atol=1e-7)


def test_we_read_what_gsply_writes(tmp_path: Path) -> None:
    gsply = pytest.importorskip("gsply", reason="the third-party parser gsply is in the dev extra")
    model = random_model(9, 8)
    columns = {name: column.numpy() for name, column in model.columns().items()}
    gsply.plywrite(
        str(tmp_path / "a.ply"),
        columns["means"],
        columns["log_scales"],
        columns["quats"],
        columns["opacity_logits"],
        columns["sh_dc"],
        columns["sh_rest"],
    )
    assert_equal(read_gaussian_ply(tmp_path / "a.ply"), model)


def test_trimesh_agrees_on_every_column(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="the third-party parser trimesh is in the dev extra")
    model = random_model(11, 15)
    write(tmp_path / "a.ply", model, antialiased=True)
    table = trimesh.load(tmp_path / "a.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert len(table.dtype.names) == 62
    appearance = model.appearance
    named = {name: model.means[:, axis] for axis, name in enumerate("xyz")}
    named |= {f"n{axis}": torch.zeros(11) for axis in "xyz"}
    named |= {f"f_dc_{c}": appearance["sh_dc"][:, c] for c in range(3)}
    named |= {f"f_rest_{15 * c + k}": appearance["sh_rest"][:, k, c] for c in range(3) for k in range(15)}
    named |= {"opacity": model.opacity_logits}
    named |= {f"scale_{axis}": model.log_scales[:, axis] for axis in range(3)}
    named |= {f"rot_{part}": model.quats[:, part] for part in range(4)}
    for name in table.dtype.names:
        np.testing.assert_allclose(table[name], named[name], rtol=2e-7, atol=1e-7, err_msg=name)


def test_every_truncation_is_refused_in_one_sentence(tmp_path: Path) -> None:
    write(tmp_path / "whole.ply", random_model(2, 3))
    whole = (tmp_path / "whole.ply").read_bytes()
    cut = tmp_path / "cut.ply"
    for length in range(len(whole)):
        cut.write_bytes(whole[:length])
        with pytest.raises(ModelFileError, match=r"cut\.ply: .*(cut short|empty).*; ") as caught:
            read_gaussian_ply(cut)
        assert "\n" not in str(caught.value)


def test_every_changed_header_byte_is_refused_or_read_without_a_crash(tmp_path: Path) -> None:
    write(tmp_path / "whole.ply", random_model(2, 0))
    whole = (tmp_path / "whole.ply").read_bytes()
    changed = tmp_path / "changed.ply"
    for position in range(whole.index(b"end_header") + 11):
        damaged = bytearray(whole)
        damaged[position] ^= 0x01
        changed.write_bytes(damaged)
        with suppress(ModelFileError):
            read_gaussian_ply(changed)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (b"vertex 2\n", b"vertex 999999999999999999\n", "need [0-9,]+ bytes"),
        (b"vertex 2\n", b"vertex 9" + b"9" * 40 + b"\n", "damaged"),
        (b"vertex 2\n", b"vertex -2\n", "damaged"),
        (b"vertex 2\n", b"vertex 1\n", "bytes too many behind the last vertex"),
        (b"element vertex", b"element edge", "no vertices"),
        (b"binary_little_endian", b"ascii", "only binary little-endian.*save it again"),
        (b"binary_little_endian", b"binary_big_endian", "only binary little-endian.*save it again"),
        (b"property float opacity", b"property float transparency", "no column 'opacity'"),
        (b"property float f_dc_0", b"property float red", "no column 'f_dc_0'"),
        (b"property float f_rest_8", b"property float f_more_8", "8 f_rest columns"),
        (b"property float f_rest_8", b"property float f_rest_9", "no column 'f_rest_8'"),
        (b"property float nx", b"property float x", "damaged"),
        (b"property float nx", b"property quad nx", "damaged"),
        (b"property float nx", b"property list uchar int nx", "mesh"),
        (b"ply\n", b"plo\n", "not a PLY file"),
    ],
)
def test_damage_is_named(tmp_path: Path, old: bytes, new: bytes, complaint: str) -> None:
    path = tmp_path / "a.ply"
    write(path, random_model(2, 3))
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    with pytest.raises(ModelFileError, match=complaint):
        read_gaussian_ply(path)


def test_other_columns_types_and_elements_are_skipped(tmp_path: Path) -> None:
    model = random_model(4, 0)
    write(tmp_path / "plain.ply", model)
    header, data = (tmp_path / "plain.ply").read_bytes().split(b"end_header\n", 1)
    table = np.frombuffer(data, np.float32).reshape(4, -1)
    row = np.dtype([("label", "u1"), ("before", "f8"), ("floats", "<f4", table.shape[1])])
    rows = np.zeros(4, row)
    rows["floats"], rows["label"] = table, 7
    header = header.replace(b"element vertex 4\n", b"element camera 2\nproperty double focal\nelement vertex 4\n")
    header = header.replace(b"property float x\n", b"property uchar label\nproperty float64 before\nproperty float x\n")
    tail = b"element face 1\nproperty list uchar int vertex_index\n"
    text = (header + tail).replace(b"\n", b"\r\n") + b"end_header\r\n"
    (tmp_path / "rich.ply").write_bytes(text + bytes(16) + rows.tobytes() + b"\x03" + bytes(12))
    assert_equal(read_gaussian_ply(tmp_path / "rich.ply"), model)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="no such file"):
        read_gaussian_ply(tmp_path / "nothing.ply")


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_not_finite_is_refused_by_its_place(tmp_path: Path, bad: float) -> None:
    means = torch.zeros(5, 3)
    means[3, 1] = bad
    table = Gaussians(means, torch.zeros(5, 3), torch.ones(5, 4), torch.zeros(5))
    write_gaussian_ply(tmp_path / "a.ply", table, torch.zeros(5, 3), torch.zeros(5, 0, 3))
    with pytest.raises(ModelFileError, match=rf"column y holds {bad} in row 3"):
        read_gaussian_ply(tmp_path / "a.ply")
