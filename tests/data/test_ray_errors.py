"""Rays are drawn where pictures are wrong, and weighted so that means over them stay what they were."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.data.ray_errors import BLOCK, UNSEEN, RayErrors

WIDTHS, HEIGHTS = torch.tensor([9, 4, 6]), torch.tensor([5, 4, 1])
RAYS = 9 * 5 + 4 * 4 + 6 * 1
BLOCKS = 3 * 2 + 1 + 2
MANY = 200_000


def drawn(errors: RayErrors, count: int = MANY, seed: int = 0):
    return errors.draw(count, torch.Generator().manual_seed(seed))


def block_of(ray: int) -> int:
    for first_block, across, first_ray, width in ((0, 3, 0, 9), (6, 1, 45, 4), (7, 2, 61, 6)):
        if ray < first_ray + width * {9: 5, 4: 4, 6: 1}[width]:
            row, column = divmod(ray - first_ray, width)
            return first_block + row // BLOCK * across + column // BLOCK
    raise AssertionError(ray)


def test_a_ray_is_drawn_with_the_block_that_its_pixel_lies_in():
    found = drawn(RayErrors(WIDTHS, HEIGHTS, 0.5))
    assert set(found.index.tolist()) == set(range(RAYS))
    assert found.blocks.tolist() == [block_of(ray) for ray in found.index.tolist()]


def test_before_any_error_is_known_all_rays_are_drawn_evenly():
    found = drawn(RayErrors(WIDTHS, HEIGHTS, 0.7))
    torch.testing.assert_close(found.weights, torch.ones(MANY), rtol=1e-6, atol=0)
    counts = torch.bincount(found.index, minlength=RAYS)
    assert ((counts - MANY / RAYS).abs() < 5 * (MANY / RAYS) ** 0.5).all()


@given(
    kept=st.lists(st.booleans(), min_size=RAYS, max_size=RAYS).filter(any),
    errors=st.lists(st.floats(0, 1, width=32), min_size=BLOCKS, max_size=BLOCKS),
    share=st.floats(0.01, 0.95),
)
def test_a_ray_counts_by_how_much_more_often_an_even_draw_takes_it(kept: list[bool], errors: list[float], share: float):
    chosen, many = torch.tensor(kept), 20_000
    of = RayErrors(WIDTHS, HEIGHTS, share)
    of.keep(chosen)
    of.errors = torch.tensor(errors)
    found = drawn(of, many)
    assert chosen[found.index].all()
    assert of.kept_rays == int(chosen.sum())
    assert found.weights.max() <= (1 + 1e-5) / (1 - share)
    rays, first = found.index.unique(return_inverse=True)
    assert len(torch.stack([first, found.weights], 1).unique(dim=0)) == len(rays)  # a ray has one weight
    chance = torch.zeros(len(rays)).index_copy_(0, first, 1 / (found.weights * of.kept_rays)).double()
    times = torch.bincount(first)
    deviation = (many * chance * (1 - chance)).clamp_min(0).sqrt()
    assert ((times - many * chance).abs() <= 6 * deviation + 1).all()
    never = 1 - chance.sum()  # what is left for rays that were not met
    assert -1e-4 <= never <= (of.kept_rays - len(rays)) * 30 / many + 1e-4


def test_a_block_that_is_wrong_by_more_is_drawn_more_often():
    of = RayErrors(WIDTHS, HEIGHTS, 0.8)
    of.errors = torch.full((BLOCKS,), 0.01)
    of.errors[6] = 0.25  # all 16 pixels of the second photograph, five times as wrong as the others
    share = (drawn(of).blocks == 6).double().mean().item()
    even = 16 / RAYS
    by_error = 5 * 16 / (5 * 16 + RAYS - 16)
    assert abs(share - (0.8 * by_error + 0.2 * even)) < 0.01


def test_a_block_that_was_not_seen_is_drawn_as_the_mean_of_the_others():
    of = RayErrors(WIDTHS, HEIGHTS, 0.8)
    of.errors[: BLOCKS - 1] = 0.04
    assert of.errors[-1] == UNSEEN
    torch.testing.assert_close(drawn(of).weights, torch.ones(MANY), rtol=1e-5, atol=0)


def test_where_nothing_is_wrong_rays_are_drawn_evenly():
    of = RayErrors(WIDTHS, HEIGHTS, 0.8)
    of.errors.zero_()
    assert torch.equal(drawn(of).weights, torch.ones(MANY))


def test_the_first_ray_of_a_block_says_its_error_and_later_ones_change_it():
    of = RayErrors(WIDTHS, HEIGHTS, 0.5)
    of.learn(torch.tensor([2, 4, 2]), torch.tensor([0.1, 0.5, 0.3]))
    torch.testing.assert_close(of.errors[[2, 4]], torch.tensor([0.2, 0.5]))
    assert (of.errors[[0, 1, 3, 5, 6, 7, 8]] == UNSEEN).all()
    of.learn(torch.tensor([2, 4, 2]), torch.tensor([0.0, 0.0, 0.0]))
    torch.testing.assert_close(of.errors[[2, 4]], torch.tensor([0.2 * 0.64, 0.5 * 0.8]))


def test_errors_that_are_no_numbers_are_left_out_and_none_is_above_one():
    of = RayErrors(WIDTHS, HEIGHTS, 0.5)
    of.learn(torch.tensor([0, 1, 2]), torch.tensor([float("nan"), float("inf"), 0.5]))
    assert of.errors[:3].tolist() == [UNSEEN, UNSEEN, 0.5]
    of.learn(torch.tensor([2]), torch.tensor([1e9]))
    torch.testing.assert_close(of.errors[2], torch.tensor(0.6))
