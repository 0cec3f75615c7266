"""Shortest axes as normals: the ellipsoids stay the same, and packing keeps which axis is shortest."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.core.gaussians import Gaussians
from ringlight.files.pack_axes import AXES_PLAN, BITS, SCALES, ready_axes, shortest_first, told_apart
from ringlight.files.packed import PACKINGS, pack_tensors, unpack_tensors

SEEDS = st.integers(0, 2**31)


def ellipsoids(rows: int, seed: int, spread: float = 1.0) -> tuple[torch.Tensor, torch.Tensor]:
    drawn = torch.Generator().manual_seed(seed)
    return spread * torch.randn(rows, 3, generator=drawn) - 3, torch.randn(rows, 4, generator=drawn)


def turned(quats: torch.Tensor) -> torch.Tensor:
    rows = len(quats)
    return Gaussians(torch.zeros(rows, 3), torch.zeros(rows, 3), quats, torch.zeros(rows)).rotations.double()


@given(rows=st.integers(0, 40), seed=SEEDS)
def test_axes_are_counted_from_the_shortest_on_and_point_where_they_did(rows: int, seed: int) -> None:
    log_scales, quats = ellipsoids(rows, seed)
    sorted_scales, sorted_quats = shortest_first(log_scales, quats)
    assert torch.equal(sorted_scales.amin(-1), sorted_scales[:, 0])
    assert torch.equal(sorted_scales.sort(-1).values, log_scales.sort(-1).values)
    order = (log_scales.argmin(-1, keepdim=True) + torch.arange(3)) % 3
    expected = turned(quats).gather(2, order[:, None, :].expand(-1, 3, 3))
    torch.testing.assert_close(turned(sorted_quats), expected, rtol=0, atol=1e-5)


@given(rows=st.integers(1, 60), seed=SEEDS, spread=st.sampled_from([1e-4, 0.01, 1.0, 5.0]))
def test_packing_keeps_which_axis_is_shortest(rows: int, seed: int, spread: float) -> None:
    log_scales, quats = ellipsoids(rows, seed, spread)
    tensors = ready_axes({SCALES: log_scales, "columns.quats": quats})
    back = unpack_tensors(pack_tensors(tensors, AXES_PLAN))[SCALES]
    assert (back[:, 0] <= back.amin(-1)).all()


@given(rows=st.integers(1, 60), seed=SEEDS, spread=st.sampled_from([1e-4, 0.01, 1.0, 5.0]))
def test_what_is_shortened_is_shortened_by_little_more_than_a_step(rows: int, seed: int, spread: float) -> None:
    log_scales, _ = shortest_first(*ellipsoids(rows, seed, spread))
    apart = told_apart(log_scales, BITS)
    step = (log_scales.amax(0) - log_scales.amin(0)).amax() / ((1 << BITS) - 1)
    assert torch.equal(apart[:, 1:], log_scales[:, 1:])
    assert (apart[:, 0] <= log_scales[:, 0]).all()
    assert (log_scales[:, 0] - apart[:, 0] <= 1.02 * step + 1e-6).all()


def test_the_plan_names_packings_that_exist() -> None:
    assert {packing for _, packing in AXES_PLAN} <= PACKINGS.keys()
