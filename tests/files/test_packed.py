"""Packings give back what they were given within the error that their docstrings state, and refuse other parts."""

import math
from pathlib import Path

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ringlight.core.directions import normalize
from ringlight.core.gaussians import Gaussians
from ringlight.errors import ModelFileError
from ringlight.files.model_file import ModelHeader, SceneFacts, read_model_file, write_model_file
from ringlight.files.pack_numbers import pack_in_steps, unpack_fixed
from ringlight.files.packed import PACKINGS, Packed, bytes_stored, pack_tensors, unpack_tensors
from ringlight.files.packing_plan import COARSE_COEFFICIENT_STEP, COARSE_STEP, COEFFICIENT_STEP, PLAN
from ringlight.files.tensor_file import read_tensors, write_tensors

SEEDS = st.integers(0, 10_000)
ROWS = st.integers(0, 40)
SPREAD = st.sampled_from([1e-6, 1e-2, 1.0, 50.0])
MANY = settings(max_examples=40)


def noise(*shape: int, seed: int, spread: float = 1.0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed)) * spread


def there_and_back(kind: str, values: torch.Tensor) -> torch.Tensor:
    restored = PACKINGS[kind].unpack(PACKINGS[kind].pack(values))
    assert restored.shape == values.shape
    assert restored.dtype == torch.float32
    assert restored.isfinite().all()
    return restored


@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD)
def test_half_floats_lose_a_part_in_two_thousand(rows: int, seed: int, spread: float) -> None:
    values = noise(rows, 3, seed=seed, spread=spread)
    error = (there_and_back("half", values) - values).abs()
    assert (error <= values.abs() * 2**-11 + 2**-25).all(), "2^-25: half of the smallest half float"


@MANY
@given(shape=st.lists(st.integers(1, 12), min_size=1, max_size=4), seed=SEEDS, spread=SPREAD)
@example(shape=[5, 10, 10, 10], seed=3600, spread=0.01)
def test_rows_lose_half_a_scale_of_their_own(shape: list[int], seed: int, spread: float) -> None:
    values = noise(*shape, seed=seed, spread=spread)
    parts = PACKINGS["rows8"].pack(values)
    scale = parts["scale"]
    row = math.prod(shape[scale.dim() :])
    assert row >= 32 or scale.dim() == 0, "a scale is shared by enough values"
    largest = values.reshape(*scale.shape, -1).abs().amax(-1)
    error = (there_and_back("rows8", values) - values).reshape(*scale.shape, -1).abs().amax(-1)
    roundings = 3 * 2**-24  # of the scale, of a number in scales, and of what comes back
    assert (error.double() <= largest.double() * (1 / 254 + roundings)).all()


@pytest.mark.parametrize("bits", [8, 10, 12, 16, 24])
@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD, shift=st.sampled_from([0.0, -3.0, 1000.0]))
def test_fixed_point_loses_half_a_step_of_the_columns_range(
    bits: int, rows: int, seed: int, spread: float, shift: float
) -> None:
    values = noise(rows, 2, 3, seed=seed, spread=spread) + shift
    error = (there_and_back(f"fixed{bits}", values) - values).abs()
    if rows:
        reach = values.double().amax(0) - values.double().amin(0)
        rounding = values.abs().double() * 2**-23
        assert (error.double() <= reach / (2**bits - 1) / 2 * (1 + 1e-9) + rounding).all()


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("rows", [0, 1, 2, 7])
def test_bits_below_a_byte_fill_bytes(bits: int, rows: int) -> None:
    parts = PACKINGS[f"fixed{bits}"].pack(noise(rows, 3, seed=1))
    assert parts["codes"].shape == (rows, 3)
    assert len(parts["fine"]) == math.ceil(rows * 3 * (bits - 8) / 8)


@MANY
@given(rows=ROWS, seed=SEEDS, spread=st.sampled_from([1e-6, 1e-2, 1.0, 20.0]))
def test_weights_lose_half_a_step_of_the_coefficients_that_they_add(rows: int, seed: int, spread: float) -> None:
    weights, basis = noise(rows, 3, seed=seed, spread=spread), noise(3, 15, 3, seed=seed + 1)
    packed = pack_tensors({"columns.basis_weights": weights, "color.basis": basis})
    assert packed.packing["columns.basis_weights"] in ("fixed8", "fixed16")
    error = (unpack_tensors(packed)["columns.basis_weights"] - weights).abs().double()
    half = COEFFICIENT_STEP / basis.flatten(1).double().norm(dim=1) / 2
    assert (error <= half * (1 + 1e-9) + weights.abs() * 2**-23).all()


@pytest.mark.parametrize("prefix", ["color.", "color.varying."])
def test_weights_that_move_opacities_too_have_finer_steps(prefix: str) -> None:
    tensors = {"columns.basis_weights": noise(40, 3, seed=1), prefix + "basis": 0.01 * noise(3, 15, 3, seed=2)}
    moving = tensors | {prefix + "opacity_basis": 6 * noise(3, 15, seed=3)}

    def worst(packed: dict[str, torch.Tensor]) -> torch.Tensor:
        moved = unpack_tensors(pack_tensors(packed))["columns.basis_weights"] - tensors["columns.basis_weights"]
        return moved.abs().amax(0).double()

    lengths = (moving[prefix + "opacity_basis"] / 6).double().norm(dim=1)
    assert (worst(moving) <= 1.001 * COEFFICIENT_STEP / lengths / 2).all()
    assert (worst(tensors) > 3 * worst(moving)).all()


@MANY
@given(seed=SEEDS, spread=st.sampled_from([0.01, 0.1, 1.0]))
def test_coarse_numbers_lie_within_half_a_coarse_step(seed: int, spread: float) -> None:
    tensors = {
        "columns.means": noise(50, 3, seed=seed),
        "columns.log_scales": noise(50, 3, seed=seed + 1) + math.log(spread),
        "columns.basis_weights": noise(50, 2, seed=seed + 2),
        "color.basis": noise(2, 15, 3, seed=seed + 3),
        "columns.quats": noise(50, 4, seed=seed + 4),
    }
    fine, coarse = (pack_tensors(tensors, coarse=coarse) for coarse in (False, True))
    assert (fine.packing["columns.log_scales"], coarse.packing["columns.log_scales"]) == ("fixed10", "fixed8")
    assert (fine.packing["columns.quats"], coarse.packing["columns.quats"]) == ("quaternions32", "turns24")
    middle = tensors["columns.log_scales"].sort(-1).values[:, 1].exp().sort().values[4]
    error = (unpack_tensors(coarse)["columns.means"] - tensors["columns.means"]).abs().max()
    reach = (tensors["columns.means"].amax(0) - tensors["columns.means"].amin(0)).max()
    assert error <= max(COARSE_STEP * middle, reach / 0xFFFF) / 2 * 1.001
    half = COARSE_COEFFICIENT_STEP / tensors["color.basis"].flatten(1).norm(dim=1) / 2
    moved = (unpack_tensors(coarse)["columns.basis_weights"] - tensors["columns.basis_weights"]).abs()
    assert (moved <= half * 1.001).all()


def test_coarse_positions_without_scales_are_as_fine_as_ever() -> None:
    means = {"columns.means": noise(20, 3, seed=1)}
    assert pack_tensors(means, coarse=True).packing == pack_tensors(means).packing


def test_weights_that_are_too_many_steps_from_zero_are_packed_over_their_range() -> None:
    weights, basis = 1e6 * noise(9, 2, seed=1), noise(2, 15, 3, seed=2)
    packed = pack_tensors({"columns.basis_weights": weights, "color.varying.basis": basis})
    torch.testing.assert_close(unpack_tensors(packed)["columns.basis_weights"], weights, rtol=0, atol=100.0)


@pytest.mark.parametrize("furthest", [127, -127, 128, 32_639, -32_639])
def test_steps_up_to_the_furthest_that_two_bytes_hold_come_back(furthest: int) -> None:
    values = torch.tensor([[float(furthest)], [0.0], [1.0]])
    parts = pack_in_steps(values, torch.ones(1, dtype=torch.float64))
    assert parts["codes"].shape[-1] == (1 if abs(furthest) < 128 else 2)
    assert torch.equal(unpack_fixed(parts), values)


@pytest.mark.parametrize("furthest", [32_640, -32_640, 32_767, 1e9])
def test_steps_beyond_two_bytes_are_refused_and_wrap_nowhere(furthest: float) -> None:
    with pytest.raises(ValueError, match="too many steps"):
        pack_in_steps(torch.tensor([[furthest], [0.0]]), torch.ones(1, dtype=torch.float64))


def test_a_column_that_is_constant_is_kept() -> None:
    values = torch.tensor([[0.1, -7.25]]).expand(5, 2).contiguous()
    assert torch.equal(there_and_back("fixed8", values), values)
    assert torch.equal(there_and_back("rows8", torch.zeros(4, 64)), torch.zeros(4, 64))


@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD)
def test_shares_lose_half_a_step_of_a_picture(rows: int, seed: int, spread: float) -> None:
    logits = noise(rows, 3, seed=seed, spread=spread)
    error = (there_and_back("share8", logits).sigmoid() - logits.sigmoid()).abs()
    assert (error <= 0.5 / 255 + 1e-6).all()


@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD)
def test_directions_turn_by_less_than_a_quarter_of_a_degree(rows: int, seed: int, spread: float) -> None:
    vectors = noise(rows, 3, seed=seed, spread=spread)
    restored = there_and_back("directions20", vectors)
    cosine = (restored.double() * normalize(vectors.double())).sum(-1).clamp(-1, 1)
    assert (cosine.acos() <= math.radians(0.25)).all()
    parts = PACKINGS["directions20"].pack(vectors)
    assert sum(tensor.numel() for tensor in parts.values()) == 2 * rows + (rows + 1) // 2


def test_the_axes_are_directions_that_lose_nothing() -> None:
    axes = torch.cat([torch.eye(3), -torch.eye(3)])
    torch.testing.assert_close(there_and_back("directions20", axes), axes, rtol=0, atol=1e-7)


@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD)
def test_turns_show_the_same_ellipsoid_within_little_more_than_a_degree(rows: int, seed: int, spread: float) -> None:
    quats = noise(rows, 4, seed=seed, spread=spread)
    restored = there_and_back("turns24", quats)
    before, after = (
        Gaussians(torch.zeros(rows, 3), torch.zeros(rows, 3), q, torch.zeros(rows)).rotations.double()
        for q in (quats, restored)
    )
    # Each axis lies along its own line; its sign is free.
    along = (before * after).sum(1).abs().clamp(max=1)
    assert (along.acos() <= math.radians(1.2)).all()
    assert sum(tensor.numel() for tensor in PACKINGS["turns24"].pack(quats).values()) == 3 * rows


def test_half_turns_are_no_turn() -> None:
    quats = torch.cat([torch.eye(4), -torch.eye(4), torch.zeros(1, 4)])
    torch.testing.assert_close(there_and_back("turns24", quats), torch.eye(4)[:1].expand(9, 4), rtol=0, atol=1e-7)


@MANY
@given(rows=ROWS, seed=SEEDS, spread=SPREAD)
def test_rotations_turn_by_less_than_half_of_a_degree(rows: int, seed: int, spread: float) -> None:
    quats = noise(rows, 4, seed=seed, spread=spread)
    restored = there_and_back("quaternions32", quats)
    before, after = (
        Gaussians(torch.zeros(rows, 3), torch.zeros(rows, 3), q, torch.zeros(rows)).rotations.double()
        for q in (quats, restored)
    )
    # The chord between rotations: Frobenius distance is 2 sqrt 2 sin(angle / 2).
    angle = 2 * ((before - after).flatten(1).norm(dim=1) / 8**0.5).clamp(max=1).asin()
    assert (angle <= math.radians(0.5)).all()


@MANY
@given(rows=ROWS, seed=SEEDS, spread=st.sampled_from((0.0, 1e-7, 1e-4, 1e-3, 3e-3, 1.0)))
def test_rotations_that_came_back_come_back_alike(rows: int, seed: int, spread: float) -> None:
    # Components that are about as large as the largest: rounding decides which one is left out.
    quats = noise(rows, 4, seed=seed).sign() + noise(rows, 4, seed=seed + 1, spread=spread)
    restored = there_and_back("quaternions32", quats)
    assert torch.equal(there_and_back("quaternions32", restored), restored)


def test_no_rotation_and_half_turns_lose_nothing() -> None:
    quats = torch.cat([torch.eye(4), -torch.eye(4), torch.zeros(1, 4)])
    expected = torch.cat([torch.eye(4), torch.eye(4), torch.eye(4)[:1]])
    torch.testing.assert_close(there_and_back("quaternions32", quats), expected, rtol=0, atol=1e-7)


# whole models


def model_tensors(rows: int = 300, seed: int = 0) -> dict[str, torch.Tensor]:
    return {
        "columns.means": noise(rows, 3, seed=seed),
        "columns.log_scales": noise(rows, 3, seed=seed + 1, spread=0.5) - 4,
        "columns.quats": noise(rows, 4, seed=seed + 2),
        "columns.opacity_logits": noise(rows, seed=seed + 3, spread=3),
        "columns.base": noise(rows, 3, seed=seed + 4, spread=2),
        "columns.latents": noise(rows, 4, seed=seed + 5),
        "columns.normals": normalize(noise(rows, 3, seed=seed + 6)),
        "columns.something_new": noise(rows, 5, seed=seed + 7),
        "color.ring.core": noise(24, 8, 8, seed=seed + 8, spread=0.1),
        "color.shading.bias": noise(64, seed=seed + 9),
        "color.sphere": noise(3, seed=seed + 10),
        "color.lit": torch.tensor(True),
        "color.box": torch.tensor([[-1.0, -1, -1], [1, 1, 1]]),
        "cameras.pinholes": noise(5, 6, seed=seed + 11, spread=500),
    }


BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
HEADER = ModelHeader("ringlight-ring", "ringlight", {}, 3, SceneFacts("s", "d", "white", (8, 8), BOX, 2.0, (), {}))


def test_the_plan_names_packings_that_exist() -> None:
    assert {packing for _, packing in PLAN} <= PACKINGS.keys()


def test_a_model_is_packed_by_what_its_tensors_hold() -> None:
    tensors = model_tensors()
    packed = pack_tensors(tensors)
    assert packed.packing == {
        "columns.means": "fixed16",
        "columns.log_scales": "fixed10",
        "columns.quats": "quaternions32",
        "columns.opacity_logits": "share8",
        "columns.base": "share8",
        "columns.latents": "fixed8",
        "columns.normals": "directions20",
        "columns.something_new": "half",
        "color.ring.core": "rows8",
        "color.shading.bias": "half",
    }
    per_row = {name: bytes_stored(packed, f"columns.{name}") for name in ("means", "quats", "base", "normals")}
    assert per_row == {"means": 300 * 6 + 48, "quats": 1200, "base": 900, "normals": 750}
    restored = unpack_tensors(packed)
    assert restored.keys() == tensors.keys()
    assert all(restored[name].shape == tensor.shape for name, tensor in tensors.items())
    kept = tensors.keys() - packed.packing.keys()
    assert all(torch.equal(restored[name], tensors[name]) for name in kept)


def test_positions_take_more_bits_where_gaussians_are_small_beside_the_scene() -> None:
    tensors = model_tensors()
    tensors["columns.log_scales"] -= 6
    assert pack_tensors(tensors).packing["columns.means"] == "fixed24"


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_kept_as_it_is(bad: float) -> None:
    tensors = model_tensors()
    tensors["columns.latents"][7, 2] = bad
    packed = pack_tensors(tensors)
    assert "columns.latents" not in packed.packing
    torch.testing.assert_close(
        unpack_tensors(packed)["columns.latents"], tensors["columns.latents"], rtol=0, atol=0, equal_nan=True
    )


def test_numbers_beyond_half_floats_are_kept() -> None:
    packed = pack_tensors({"columns.something_new": torch.tensor([[1.0, 7e4]])})
    assert packed.packing == {}


def test_packing_again_loses_nothing_more() -> None:
    once = unpack_tensors(pack_tensors(model_tensors()))
    twice = unpack_tensors(pack_tensors(once))
    for name, tensor in once.items():
        torch.testing.assert_close(twice[name], tensor, rtol=1e-5, atol=1e-6, msg=name)


def test_a_packed_file_reads_as_a_model(tmp_path: Path) -> None:
    packed = pack_tensors(model_tensors())
    write_model_file(tmp_path / "m", packed, HEADER)
    found = read_model_file(tmp_path / "m")
    assert found.header == HEADER
    assert found.stored.packing == packed.packing
    expected = unpack_tensors(packed)
    assert found.tensors.keys() == expected.keys()
    assert all(torch.equal(found.tensors[name], tensor) for name, tensor in expected.items())


def test_files_of_earlier_versions_are_read(tmp_path: Path) -> None:
    earlier = {"columns.log_scales": "fixed8", "columns.sh_dc": "fixed16"}
    tensors = model_tensors() | {"columns.sh_dc": noise(300, 3, seed=12)}
    write_model_file(tmp_path / "m", pack_tensors(tensors, (*earlier.items(), *PLAN)), HEADER)
    found = read_model_file(tmp_path / "m")
    assert found.stored.packing.items() >= earlier.items()
    for name in earlier:
        assert (found.tensors[name] - tensors[name]).abs().amax() < 0.01


def damaged(path: Path, change) -> str:  # type: ignore[no-untyped-def]
    """The sentence about a packed file after ``change(tensors, metadata)``."""
    write_model_file(path, pack_tensors(model_tensors()), HEADER)
    file = read_tensors(path)
    change(file.tensors, file.metadata)
    write_tensors(path, file.tensors, file.metadata)
    with pytest.raises(ModelFileError, match=r"damaged.*; copy it again") as caught:
        read_model_file(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "replacement"),
    [
        ("columns.base:share", None),
        ("columns.base:share", torch.zeros(3)),
        ("columns.means:codes", torch.zeros(300, 3, 9, dtype=torch.uint8)),
        ("columns.means:codes", torch.zeros(7, dtype=torch.uint8)),
        ("columns.means:step", torch.zeros(4, dtype=torch.float64)),
        ("columns.quats:words", torch.zeros(300, 5, dtype=torch.uint8)),
        ("columns.log_scales:fine", torch.zeros(224, dtype=torch.uint8)),
        ("columns.log_scales:fine", torch.zeros(225, dtype=torch.int8)),
        ("columns.log_scales:codes", torch.zeros((), dtype=torch.uint8)),
        ("columns.normals:high", torch.zeros(149, dtype=torch.uint8)),
        ("columns.normals:low", torch.zeros(300, 3, dtype=torch.uint8)),
        ("color.ring.core:scale", torch.zeros(23)),
        ("color.ring.core:codes", torch.zeros((), dtype=torch.int8)),
        ("columns.nobody:codes", torch.zeros(3, dtype=torch.uint8)),
    ],
)
def test_damaged_parts_are_named(tmp_path: Path, name: str, replacement: torch.Tensor | None) -> None:
    def change(tensors: dict[str, torch.Tensor], metadata: dict[str, str]) -> None:
        del metadata
        tensors.pop(name, None)
        if replacement is not None:
            tensors[name] = replacement

    assert name.split(":")[0] in damaged(tmp_path / "m", change)


@pytest.mark.parametrize("packing", ['{"columns.base": "zip9"}', "[1]", "{"])
def test_damaged_packings_are_named(tmp_path: Path, packing: str) -> None:
    def change(tensors: dict[str, torch.Tensor], metadata: dict[str, str]) -> None:
        for stored in [name for name in tensors if ":" in name and not name.startswith("columns.base:")]:
            del tensors[stored]
        metadata["packing"] = packing

    damaged(tmp_path / "m", change)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    write_model_file(tmp_path / "whole", pack_tensors({"columns.base": noise(9, 3, seed=0)}), HEADER)
    whole = (tmp_path / "whole").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "cut").write_bytes(whole[:length])
        with pytest.raises(ModelFileError, match=r"cut short|empty"):
            read_model_file(tmp_path / "cut")


def test_equal_models_give_equal_bytes(tmp_path: Path) -> None:
    write_model_file(tmp_path / "one", pack_tensors(model_tensors()), HEADER)
    shuffled: Packed = pack_tensors(dict(reversed(model_tensors().items())))
    write_model_file(tmp_path / "two", shuffled, HEADER)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
