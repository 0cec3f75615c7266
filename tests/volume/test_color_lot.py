"""Samples that weigh little pass gradients on by lot, and the mean of these is what it would be."""

import torch

from ringlight.volume.color_lot import chosen_by_lot, with_gradient_by_lot

LOT = 0.01


def jitter(number: int) -> torch.Tensor:
    return torch.rand(3, generator=torch.Generator().manual_seed(number))


def test_what_weighs_enough_is_always_chosen_and_counts_once():
    weights = torch.tensor([0.5, 0.001, LOT, 0.02])
    for number in range(20):
        chosen, factors = chosen_by_lot(weights, LOT, jitter(number))
        assert {0, 2, 3} <= set(chosen.tolist())
        assert (factors[chosen != 1] == 1).all()


def test_the_mean_gradient_is_the_whole_one():
    weights = torch.rand(200, generator=torch.Generator().manual_seed(0)) * 0.02
    rounds = 2000
    total = torch.zeros(200)
    for number in range(rounds):
        chosen, factors = chosen_by_lot(weights, LOT, jitter(number))
        total[chosen] += factors
    chance = (weights / LOT).clamp_max(1)
    deviation = ((1 - chance) / chance / rounds).sqrt()
    assert ((total / rounds - 1).abs() < 5 * deviation + 1e-6).all()


def test_without_a_lot_all_are_chosen():
    weights = torch.tensor([0.5, 1e-4])
    chosen, factors = chosen_by_lot(weights, 0.0, jitter(0))
    assert chosen.tolist() == [0, 1]
    assert factors.tolist() == [1, 1]


def test_one_jitter_draws_the_same_and_another_does_not():
    weights = torch.full((500,), LOT / 2)
    first, again, other = (chosen_by_lot(weights, LOT, jitter(number))[0] for number in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_colors_stay_and_their_gradients_are_those_of_the_chosen():
    weights = torch.tensor([0.5, 1e-4, 0.004, 0.009])
    colors = torch.rand(4, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
    shown = with_gradient_by_lot(colors, weights, LOT, jitter(3))
    assert torch.equal(shown, colors)
    shown.sum().backward()
    chosen, factors = chosen_by_lot(weights, LOT, jitter(3))
    assert colors.grad is not None
    assert torch.equal(colors.grad, torch.zeros(4).index_copy(0, chosen, factors)[:, None].expand(4, 3))
    assert len(chosen) < 4


def test_no_sample_is_no_mistake():
    chosen, factors = chosen_by_lot(torch.zeros(0), LOT, torch.zeros(0))
    assert len(chosen) == len(factors) == 0
