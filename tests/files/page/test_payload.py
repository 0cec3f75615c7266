"""The page's numbers: a reader written from the format alone gets every stored byte back."""

import json
import zlib

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.files.packed import Packed, pack_tensors
from ringlight.files.page.payload import payload_of

TYPES = {"u8": np.uint8, "i8": np.int8, "u16": np.uint16, "f32": np.float32, "f64": np.float64, "i64": np.int64}


def read(payload: bytes) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    data = zlib.decompress(payload)
    header = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
    assert header["start"] % 8 == 0
    found = {}
    for part in header["parts"]:
        values = np.frombuffer(data, TYPES[part["type"]], part["count"], header["start"] + part["at"])
        if part["order"] != "rows":
            values = values.reshape(-1, part["shape"][0]).T.reshape(part["shape"])
        if part["order"] == "steps":
            values = summed(values)
        found[f"{part['tensor']}:{part['part']}"] = values.reshape(part["shape"])
    return found, header["packing"]


def summed(folded: np.ndarray) -> np.ndarray:
    places = 8 * np.arange(folded.shape[-1])
    codes = (folded.astype(np.int64) << places).sum(-1)
    steps = np.where(codes % 2 == 1, -(codes + 1) // 2, codes // 2)
    whole = steps.cumsum(0) % (1 << 8 * len(places))
    return ((whole[..., None] >> places) & 0xFF).astype(np.uint8)


def columns(rows: int, seed: int) -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return {
        "columns.means": 30 * random(rows, 3),
        "columns.log_scales": random(rows, 3) - 4,
        "columns.quats": random(rows, 4),
        "columns.opacity_logits": random(rows),
        "columns.normals": random(rows, 3),
        "columns.sh_rest": random(rows, 15, 3),
        "color.basis": random(8, 15, 3),
        "color.small": random(5),
        "color.half": random(100),
        "color.lit": torch.tensor(True),
        "color.active_degree": torch.tensor(3),
    }


@given(st.integers(0, 40), st.integers(0, 3))
def test_every_stored_byte_comes_back(rows: int, seed: int) -> None:
    packed = pack_tensors(columns(rows, seed))
    others = {"cameras": torch.arange(36.0).reshape(2, 18)}
    found, packing = read(payload_of(packed, others))
    assert packing == packed.packing
    for name, tensor in (packed.tensors | others).items():
        stored = tensor.numpy()
        key = name if ":" in name else f"{name}:"
        assert found[key].tobytes() == stored.tobytes(), name
        assert found[key].shape == stored.shape


def test_equal_models_give_equal_bytes() -> None:
    assert payload_of(pack_tensors(columns(20, 1)), {}) == payload_of(pack_tensors(columns(20, 1)), {})


def test_neighbours_in_space_take_fewer_bytes() -> None:
    line = torch.linspace(0, 1, 5_000)
    ordered = {"columns.means": torch.stack([line, line.square(), line.sin()], -1)}
    shuffled = {"columns.means": ordered["columns.means"][torch.randperm(5_000, generator=torch.Generator())]}
    assert len(payload_of(pack_tensors(ordered), {})) < 0.3 * len(payload_of(pack_tensors(shuffled), {}))


def test_an_empty_model_has_a_payload() -> None:
    found, packing = read(payload_of(Packed({}, {}), {}))
    assert not found
    assert not packing
