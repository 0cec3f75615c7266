"""Kernels find the blocks, corners and parts of points that torch finds, and their sums and products, both ways."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some

from ringlight import _kernels
from ringlight.volume.tt_bags import Bags, bag_sums, reference_sums
from ringlight.volume.tt_blocks import blocks_of, corner_bags, parts_of, whole
from ringlight.volume.tt_products import part_products, reference_products

SAME = {"rtol": 1e-5, "atol": 3e-5}


def places(count: int, seed: int = 0) -> torch.Tensor:
    """In a corner of the box and beyond it, so that some blocks are not touched; some are nodes, some its last one."""
    drawn = torch.Generator().manual_seed(seed)
    found = torch.rand(count, 3, generator=drawn) * 0.7 - 0.05
    found[::7] = (found[::7] * 8).round() / 8
    found[1::50] = 1.0
    return found


def by_torch(points: torch.Tensor) -> torch.Tensor:
    """The same points, of which a gradient is wanted: kernels take none of these."""
    return points.clone().requires_grad_()


def compared(ours, reference, leaves) -> None:
    torch.testing.assert_close(ours, reference, **SAME)
    weights = torch.randn(ours.shape, generator=torch.Generator().manual_seed(1))
    for one, other in zip(
        torch.autograd.grad((ours * weights).sum(), leaves),
        torch.autograd.grad((reference * weights).sum(), leaves),
        strict=True,
    ):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)


@given(some.integers(2, 6), some.integers(1, 300), some.data())
@settings(deadline=None, max_examples=25)
def test_kernels_find_what_torch_finds(levels: int, count: int, data):
    first = data.draw(some.integers(0, levels))
    points = places(count)
    blocks, expected = blocks_of(points, levels, first), blocks_of(by_torch(points), levels, first)
    assert torch.equal(blocks.paths, expected.paths)
    assert torch.equal(blocks.slots, expected.slots)
    for of in (blocks, whole(levels, points.device)):
        ours, reference = corner_bags(points, of), corner_bags(by_torch(points), of)
        assert torch.equal(ours.index, reference.index)
        assert torch.equal(ours.shares, reference.shares.detach())
    ours, reference = parts_of(points, blocks), parts_of(by_torch(points), blocks)
    assert torch.equal(ours.ends, reference.ends)
    assert torch.equal(ours.owners, reference.owners)
    assert torch.equal(ours.bags.index, reference.bags.index)
    assert torch.equal(ours.bags.shares, reference.bags.shares.detach())


def test_a_place_that_is_no_number_lies_at_the_lowest_corner():
    points = torch.tensor([[float("nan"), 0.5, 0.5], [0.0, 0.5, 0.5]])
    for of in (whole(3, points.device), blocks_of(points, 3, 1)):
        bags = corner_bags(points, of)
        assert torch.equal(bags.index[0], bags.index[1])
        assert torch.equal(bags.shares[0], bags.shares[1])
    lowest = blocks_of(points[1:], 3, 1)
    blocks = blocks_of(points, 3, 1)
    assert torch.equal(blocks.paths, lowest.paths)
    assert torch.equal(parts_of(points, blocks).bags.index[0], parts_of(points[1:], lowest).bags.index[0])


@pytest.mark.parametrize("width", [1, 5, 16, 27, 64, 280])
def test_sums_of_rows_and_their_gradients_are_those_of_torch(width: int):
    bags = corner_bags(places(700), whole(4, torch.device("cpu")))
    rows = torch.randn(8**4, width, generator=torch.Generator().manual_seed(0)).requires_grad_()
    compared(bag_sums(rows, bags), reference_sums(rows, bags), [rows])


@pytest.mark.parametrize(("outputs", "width"), [(1, 8), (3, 30), (27, 64), (27, 280), (40, 17), (64, 8), (200, 30)])
def test_products_of_parts_and_their_gradients_are_those_of_torch(outputs: int, width: int):
    points = places(900)
    blocks = blocks_of(points, 5, 2)
    parts = parts_of(points, blocks)
    drawn = torch.Generator().manual_seed(0)
    matrices = torch.randn(len(blocks.paths), outputs, width, generator=drawn).requires_grad_()
    rows = torch.randn(8**3, width, generator=drawn).requires_grad_()
    compared(part_products(parts, matrices, rows), reference_products(parts, matrices, rows), [matrices, rows])


@pytest.mark.usefixtures("all_cores_afterwards")
def test_bits_are_the_same_for_any_number_of_threads():
    points = places(5000)
    blocks = blocks_of(points, 5, 2)
    drawn = torch.Generator().manual_seed(0)
    matrices = torch.randn(len(blocks.paths), 27, 70, generator=drawn).requires_grad_()
    rows = torch.randn(8**3, 70, generator=drawn).requires_grad_()
    entries = torch.randn(len(blocks.paths) * 8**3, 5, generator=drawn).requires_grad_()
    states = []
    for threads in (1, 2, 4):
        _kernels.set_threads(threads)
        parts = parts_of(points, blocks)
        products = part_products(parts, matrices, rows)
        sums = bag_sums(entries, corner_bags(points, blocks))
        total = products.square().sum() + sums.square().sum()
        states.append([products, sums, *torch.autograd.grad(total, [matrices, rows, entries])])
    for others in states[1:]:
        assert all(torch.equal(one, other) for one, other in zip(states[0], others, strict=True))


def test_kernels_refuse_what_does_not_fit():
    rows, found = torch.zeros(4, 3), torch.zeros(2, 3)
    index, shares = torch.zeros(2, 8, dtype=torch.int32), torch.zeros(2, 8)
    index[1, 7] = 4
    with pytest.raises(ValueError, match="a row is out of range"):
        bag_sums(rows, Bags(index, shares))
    with pytest.raises(ValueError, match="a bag for each sum"):
        _kernels.train_gather((index[:1], shares[:1]), rows, found)
    slots = torch.full((8,), 3, dtype=torch.int32)
    with pytest.raises(ValueError, match="a slot is out of range"):
        _kernels.train_corners(torch.rand(2, 3), (3, 1), slots, 3, (index, shares))
    with pytest.raises(ValueError, match="1 to 10 levels"):
        _kernels.train_touch(torch.rand(2, 3), (11, 1), torch.zeros(8, dtype=torch.int8))
    slots.zero_()
    for ends, message in (([0], "an owner for each part"), ([1], "must begin where")):
        with pytest.raises(ValueError, match=message):
            _kernels.train_parts(
                torch.rand(2, 3), (3, 0), slots[:1], torch.tensor(ends), index[:1, 0].contiguous(),
                (index[:1], shares[:1]),
            )  # fmt: skip
