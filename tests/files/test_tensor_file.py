"""What is written is read back to the bit; what is damaged is refused in one sentence, before memory is asked for."""

import errno
import io
import json
import os
import struct
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import safetensors.torch
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.errors import ModelFileError
from ringlight.files import tensor_file
from ringlight.files.tensor_file import read_metadata, read_tensors, write_tensors
from ringlight.files.tensor_header import DTYPES

SHAPES = st.lists(st.integers(0, 4), max_size=4).map(tuple)
CONTENTS = st.dictionaries(
    st.text(min_size=1, max_size=12).filter(lambda name: name != "__metadata__"),
    st.tuples(SHAPES, st.sampled_from(list(DTYPES.values()))),
    max_size=5,
)


def random_tensor(shape: tuple[int, ...], dtype: torch.dtype, seed: int) -> torch.Tensor:
    values = torch.rand(shape, generator=torch.Generator().manual_seed(seed)) * 100
    return values.gt(50) if dtype is torch.bool else values.to(dtype)


def small_file(path: Path) -> bytes:
    write_tensors(path, {"a": torch.arange(6.0).reshape(2, 3), "b": torch.tensor([1, 2])}, {"note": "x"})
    return path.read_bytes()


def assembled(header: object, data: bytes) -> bytes:
    encoded = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(encoded)) + encoded + data


def entry(dtype: object = "F32", shape: object = (2,), offsets: object = (0, 8)) -> dict[str, object]:
    return {"dtype": dtype, "shape": shape, "data_offsets": offsets}


@settings(max_examples=40)
@given(contents=CONTENTS, metadata=st.dictionaries(st.text(max_size=8), st.text(max_size=20), max_size=3))
def test_write_then_read_gives_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    contents: dict[str, tuple[tuple[int, ...], torch.dtype]],
    metadata: dict[str, str],
) -> None:
    path = tmp_path_factory.mktemp("tensors") / "file.safetensors"
    tensors = {name: random_tensor(*what, seed) for seed, (name, what) in enumerate(contents.items())}
    write_tensors(path, tensors, metadata)
    found = read_tensors(path)
    assert found.metadata == metadata == read_metadata(path)
    assert found.tensors.keys() == tensors.keys()
    for name, tensor in tensors.items():
        assert found.tensors[name].dtype == tensor.dtype
        assert torch.equal(found.tensors[name], tensor)


def test_the_library_reads_ours_and_we_read_the_librarys(tmp_path: Path) -> None:
    tensors = {dtype: random_tensor((3, 2), DTYPES[dtype], 1) for dtype in DTYPES}
    write_tensors(tmp_path / "ours", tensors, {"k": "v"})
    safetensors.torch.save_file(tensors, tmp_path / "theirs", metadata={"k": "v"})
    theirs = safetensors.torch.load_file(tmp_path / "ours")
    ours = read_tensors(tmp_path / "theirs")
    assert ours.metadata == {"k": "v"}
    for name, tensor in tensors.items():
        assert torch.equal(theirs[name], tensor)
        assert torch.equal(ours.tensors[name], tensor)


def test_equal_content_gives_equal_bytes_in_any_order(tmp_path: Path) -> None:
    tensors = {"b": torch.ones(3), "a": torch.zeros(2, 2), "c": torch.ones(5, dtype=torch.uint8)}
    metadata = {"y": "1", "x": "2"}
    write_tensors(tmp_path / "one", tensors, metadata)
    write_tensors(tmp_path / "two", dict(reversed(tensors.items())), dict(reversed(metadata.items())))
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_views_and_gradients_are_written_by_value(tmp_path: Path) -> None:
    base = torch.arange(12.0).reshape(3, 4).requires_grad_()
    write_tensors(tmp_path / "f", {"turned": base.T, "row": base[1]}, {})
    found = read_tensors(tmp_path / "f").tensors
    assert torch.equal(found["turned"], base.detach().T)
    assert torch.equal(found["row"], base.detach()[1])


def test_every_truncation_is_refused_in_one_sentence(tmp_path: Path) -> None:
    whole = small_file(tmp_path / "whole")
    cut = tmp_path / "cut"
    for length in range(len(whole)):
        cut.write_bytes(whole[:length])
        with pytest.raises(ModelFileError, match=r"cut: .*(cut short|empty).*; ") as caught:
            read_tensors(cut)
        assert "\n" not in str(caught.value)


def test_every_changed_header_byte_is_refused_or_read_without_a_crash(tmp_path: Path) -> None:
    whole = small_file(tmp_path / "whole")
    changed = tmp_path / "changed"
    for position in range(8 + struct.unpack("<Q", whole[:8])[0]):
        for flip in (0x01, 0x80):
            damaged = bytearray(whole)
            damaged[position] ^= flip
            changed.write_bytes(damaged)
            with suppress(ModelFileError):
                read_tensors(changed)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (assembled({"a": entry()}, bytes(8)) + b"more", "4 bytes too many"),
        (assembled({"a": entry(offsets=(0, 4))}, bytes(4)), "wrong number of bytes"),
        (assembled({"a": entry(shape=(2**40,), offsets=(0, 2**42))}, bytes(8)), "cut short"),
        (assembled({"a": entry(shape=(2**70,), offsets=(0, 2**72))}, bytes(8)), "absurd shape"),
        (assembled({"a": entry(shape=(0, 2**70), offsets=(0, 0))}, b""), "absurd shape"),
        (assembled({"a": entry(), "b": entry()}, bytes(16)), "overlaps"),
        (assembled({"a": entry(), "b": entry(offsets=(4, 12))}, bytes(12)), "overlaps"),
        (assembled({"a": entry(offsets=(8, 16))}, bytes(16)), "gap"),
        (assembled({"a": entry(dtype="F4")}, bytes(8)), "unknown type"),
        (assembled({"a": entry(dtype=["F32"])}, bytes(8)), "unknown type"),
        (assembled({"a": entry(shape=(-2,))}, bytes(8)), "no valid shape"),
        (assembled({"a": entry(shape=(True, 2))}, bytes(8)), "no valid shape"),
        (assembled({"a": entry(offsets=(0, 4, 8))}, bytes(8)), "no valid shape"),
        (assembled({"a": 3}, b""), "unknown type"),
        (assembled({"two\nlines": 3}, b""), r"'two\\nlines' has an unknown type"),
        (assembled({"__metadata__": {"a": 3}}, b""), "not strings"),
        (assembled({"__metadata__": "a"}, b""), "not strings"),
        (assembled(b'{"a": \xff}', b""), "not JSON"),
        (assembled(b'{"a":' * 50_000, b""), "not JSON"),
        (struct.pack("<Q", 2**63) + b"{}", "announces a header"),
        (struct.pack("<Q", 99_999_999) + b"{}", "cut short inside its header"),
        (b"PK\x03\x04 this is a zip, or a pickle", "not a safetensors file"),
        (b"ply\nformat ascii 1.0\n", "not a safetensors file"),
    ],
)
def test_damage_is_named(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "damaged"
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=complaint) as caught:
        read_tensors(path)
    assert ";" in str(caught.value)


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="no such file"):
        read_tensors(tmp_path / "nothing")
    with pytest.raises(ModelFileError, match="is a folder"):
        read_tensors(tmp_path)


def test_every_changed_byte_is_noticed(tmp_path: Path) -> None:
    whole = small_file(tmp_path / "whole")
    changed = tmp_path / "changed"
    for position in range(len(whole)):
        for flip in (0x01, 0x80):
            damaged = bytearray(whole)
            damaged[position] ^= flip
            changed.write_bytes(damaged)
            with pytest.raises(ModelFileError):
                read_tensors(changed, checksum_required=True)


def test_files_of_other_programs_have_no_checksum(tmp_path: Path) -> None:
    safetensors.torch.save_file({"a": torch.ones(2)}, tmp_path / "theirs")
    assert torch.equal(read_tensors(tmp_path / "theirs").tensors["a"], torch.ones(2))
    with pytest.raises(ModelFileError, match="checksum"):
        read_tensors(tmp_path / "theirs", checksum_required=True)


class Dribbling(io.RawIOBase):
    """A file whose reads give three bytes at most, and from ``until`` on an error."""

    name, mode = "dribbling", "rb"

    def __init__(self, content: bytes, until: int) -> None:
        self.inner, self.until = io.BytesIO(content), until

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, *place: int) -> int:
        return self.inner.seek(*place)

    def readinto(self, buffer: bytearray) -> int:
        if self.inner.tell() > self.until:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return self.inner.readinto(memoryview(buffer)[:3])


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 2.0])
def test_short_reads_are_read_on_and_failing_ones_are_one_sentence(
    tmp_path: Path, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = small_file(tmp_path / "whole")
    reader = io.BufferedReader(Dribbling(content, int(share * len(content))), buffer_size=16)
    monkeypatch.setattr(tensor_file, "Path", lambda path: SimpleNamespace(open=lambda mode: reader))
    if share > 1:
        assert torch.equal(read_tensors(tmp_path / "whole").tensors["b"], torch.tensor([1, 2]))
        return
    with pytest.raises(ModelFileError, match=r"cannot be read: Input/output error; "):
        read_tensors(tmp_path / "whole")


@pytest.mark.parametrize(
    "header",
    [
        {"__metadata__": {"ringlight.checksum": "\ud800"}},
        {"__metadata__": {"note": "x\udfff"}},
        {"__metadata__": {"\ud800": "x"}},
        {"\ud8ff": entry()},
    ],
)
def test_half_a_character_is_damage(header: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(assembled(header, bytes(8)))
    for read in (read_tensors, read_metadata):
        with pytest.raises(ModelFileError, match="the file is damaged"):
            read(path)
    path.write_bytes(assembled({"__metadata__": {"note": "\U0001f600"}}, b""))
    assert read_metadata(path) == {"note": "\U0001f600"}
