"""The light field's Adam bears the jumps that density control makes of its gradients."""

import dataclasses

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_
from ringlight.fit.rates import Rate
from ringlight.methods.ringlight import PAPER, RingLightRecipe

JUMP = 30.0
"""When opacities are reset the picture is all wrong at once."""


def longest_step(recipe: RingLightRecipe) -> float:
    """After a jump of the gradients, in units of the rate."""
    group = dataclasses.replace(recipe._groups(extent=1.0)["color.*"], rate=Rate.constant(1.0))
    value, mean, square = torch.zeros(1), torch.zeros(1), torch.zeros(1)
    longest = 0.0
    for number in range(1, 1100):
        before = value.clone()
        gradient = torch.full((1,), JUMP if number > 1000 else 1.0)
        adam_([Update(value, gradient, mean, square, group, 1.0, number)])
        longest = max(longest, (value - before).abs().item())
    return longest


def test_a_jump_of_the_gradients_makes_no_long_steps():
    assert longest_step(RingLightRecipe()) < 2.5
    assert longest_step(PAPER) > 5


@pytest.mark.parametrize("beta2", [-0.1, 1.0, float("nan")])
def test_a_memory_that_never_ends_is_refused(beta2: float):
    with pytest.raises(RecipeError, match="field_beta2"):
        RingLightRecipe(field_beta2=beta2)
