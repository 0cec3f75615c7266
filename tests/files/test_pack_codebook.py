"""Rows that occur more than once are stored once; what comes back are half floats, and other parts are refused."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.errors import ModelFileError
from ringlight.files.pack_codebook import (
    WIDEST_ROW,
    pack_codebook,
    pack_codebook8,
    unpack_codebook,
    unpack_codebook8,
)
from ringlight.files.pack_numbers import LARGEST_HALF
from ringlight.files.packed import Packed, pack_exactly, pack_tensors, unpack_tensors

PLAN = (("columns.sh_rest", "codebook"), ("columns.*", "half"))


def rows(count: int, codes: int, alone: int, seed: int = 0) -> torch.Tensor:
    """``count`` rows of so many codes, and ``alone`` others, in any order; half floats."""
    drawn = torch.Generator().manual_seed(seed)
    book = torch.randn(max(codes, 1), 8, 3, generator=drawn)
    shared = book[torch.randint(max(codes, 1), (count,), generator=drawn)]
    values = torch.cat([shared, torch.randn(alone, 8, 3, generator=drawn)])
    return values[torch.randperm(len(values), generator=drawn)].half().float()


@settings(max_examples=40)
@given(st.integers(0, 60), st.integers(1, 9), st.integers(0, 20), st.integers(0, 1000))
def test_half_floats_come_back_with_the_same_bits(count: int, codes: int, alone: int, seed: int):
    values = rows(count, codes, alone, seed)
    assert torch.equal(unpack_codebook(pack_codebook(values)), values)


def test_others_are_rounded_to_half_floats():
    values = torch.randn(20, 3, generator=torch.Generator().manual_seed(1))
    assert torch.equal(unpack_codebook(pack_codebook(values)), values.half().float())


def test_a_shared_row_takes_two_bytes_and_a_bit():
    parts = pack_codebook(rows(4000, 5, 80))
    assert len(parts["book"]) == 5
    assert len(parts["own"]) == 80
    assert {name: part.numel() * part.element_size() for name, part in parts.items()} == {
        "book": 5 * 48,
        "codes": 4000 * 2,
        "shared": 510,
        "own": 80 * 48,
    }


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("codes", torch.full((4000, 2), 255, dtype=torch.uint8)),  # beyond the codebook
        ("codes", torch.zeros(4000, 3, dtype=torch.uint8)),
        ("shared", torch.zeros(510, dtype=torch.uint8)),
        ("shared", torch.zeros(9, dtype=torch.uint8)),
        ("own", torch.zeros(80, 7, 3, dtype=torch.float16)),
        ("book", torch.zeros(5, 8, 3)),
        ("book", torch.tensor(0.0, dtype=torch.float16)),
        ("own", torch.tensor(0.0, dtype=torch.float16)),
    ],
)
def test_other_parts_are_refused(name: str, damage: torch.Tensor):
    parts = pack_codebook(rows(4000, 5, 80))
    with pytest.raises(ValueError, match=r"."):
        unpack_codebook(parts | {name: damage})


def test_rows_without_dimensions_are_refused():
    alone = torch.tensor(0.0, dtype=torch.float16)
    with pytest.raises(ValueError, match="no rows, or rows of more than 64 numbers"):
        unpack_codebook(pack_codebook(rows(4000, 5, 80)) | {"book": alone, "own": alone})


@pytest.mark.parametrize(("kind", "packing"), [(torch.float16, "codebook"), (torch.uint8, "codebook8")])
def test_few_bytes_that_announce_terabytes_are_refused_before_any_is_asked_for(kind: torch.dtype, packing: str):
    """220,000 rows of a codebook of one row, as wide as half a megabyte allows."""
    width, count = 250_000, 220_000
    parts = {
        "book": torch.zeros(1, width, dtype=kind),
        "codes": torch.zeros(count, 2, dtype=torch.uint8),
        "shared": torch.full((count // 8,), 255, dtype=torch.uint8),
        "own": torch.zeros(0, width, dtype=kind),
        "exponents": torch.zeros(width, dtype=torch.uint8),
    }
    packed = Packed({f"columns.sh_rest:{name}": part for name, part in parts.items()}, {"columns.sh_rest": packing})
    with pytest.raises(
        ModelFileError, match=rf"'columns\.sh_rest' does not fit its packing {packing} \(no rows, or rows of"
    ):
        unpack_tensors(packed)


def test_rows_that_could_not_be_read_again_are_kept():
    wide = {"columns.sh_rest": torch.zeros(3, WIDEST_ROW + 1)}
    assert pack_tensors(wide, PLAN).packing == {}
    widest = {"columns.sh_rest": torch.ones(3, WIDEST_ROW)}
    assert pack_tensors(widest, PLAN).packing == {"columns.sh_rest": "codebook"}
    assert torch.equal(unpack_tensors(pack_tensors(widest, PLAN))["columns.sh_rest"], widest["columns.sh_rest"])


def test_only_what_loses_nothing_is_packed():
    exact = {
        "columns.sh_rest": rows(50, 3, 5),
        "columns.quats": torch.ones(55, 4),
        "cameras.pinholes": torch.ones(2, 6),
    }
    lossy = exact | {"columns.quats": torch.full((55, 4), 0.1), "columns.sh_rest": exact["columns.sh_rest"] + 1e-6}
    assert pack_exactly(exact, PLAN).packing == {"columns.sh_rest": "codebook", "columns.quats": "half"}
    assert pack_exactly(lossy, PLAN).packing == {}
    for tensors in (exact, lossy):
        back = unpack_tensors(pack_exactly(tensors, PLAN))
        assert back.keys() == tensors.keys()
        assert all(torch.equal(back[name], tensor) for name, tensor in tensors.items())


@settings(max_examples=40)
@given(st.integers(0, 60), st.integers(1, 9), st.integers(0, 20), st.floats(-8, 4), st.integers(0, 1000))
def test_bytes_come_back_with_the_same_bits_once_they_are_rounded(
    count: int, codes: int, alone: int, magnitude: float, seed: int
):
    values = rows(count, codes, alone, seed) * 10**magnitude
    rounded = unpack_codebook8(pack_codebook8(values))
    assert torch.equal(unpack_codebook8(pack_codebook8(rounded)), rounded)
    assert torch.equal(rounded.half().float(), rounded)
    if len(values):
        largest = values.abs().amax(0)
        assert ((rounded - values).abs() <= (largest / 127).clamp_min(2.0**-25) * (1 + 1e-6)).all()


def test_bytes_never_wrap_round_at_the_largest_half_float():
    values = torch.tensor([[LARGEST_HALF, 65_281.0], [-LARGEST_HALF, 2.0], [1.0, -65_281.0]])
    rounded = unpack_codebook8(pack_codebook8(values))
    assert ((rounded - values).abs() <= LARGEST_HALF / 127).all()
    assert torch.equal(unpack_codebook8(pack_codebook8(rounded)), rounded)
    assert torch.equal(rounded.half().float(), rounded)


def test_a_shared_row_of_bytes_takes_two_of_them_and_a_bit():
    parts = pack_codebook8(rows(4000, 5, 80))
    sizes = {name: part.numel() * part.element_size() for name, part in parts.items()}
    assert sizes == {"book": 5 * 24, "codes": 4000 * 2, "shared": 510, "own": 80 * 24, "exponents": 24}


@pytest.mark.parametrize("damage", [torch.zeros(7, 3, dtype=torch.uint8), torch.zeros(8, 3)])
def test_other_exponents_are_refused(damage: torch.Tensor):
    parts = pack_codebook8(rows(40, 5, 8))
    parts["exponents"] = damage
    with pytest.raises(ValueError, match="exponents"):
        unpack_codebook8(parts)
    del parts["exponents"]
    with pytest.raises(KeyError):
        unpack_codebook8(parts)
