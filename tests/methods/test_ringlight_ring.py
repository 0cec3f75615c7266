"""How the light field's Adam bears the jumps that density control makes of its gradients is a setting."""

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_
from ringlight.methods.ringlight_ring import RingLightRingRecipe
from tiny_scene import tiny_scene

JUMP = 30.0
"""When opacities are reset the picture is all wrong at once."""


def longest_step(recipe: RingLightRingRecipe) -> float:
    """After a jump of the gradients, in units of the rate."""
    group = recipe.course(tiny_scene()).groups["color.*"]
    value, mean, square = torch.zeros(1), torch.zeros(1), torch.zeros(1)
    longest = 0.0
    for number in range(1, 1100):
        before = value.clone()
        gradient = torch.full((1,), JUMP if number > 1000 else 1.0)
        adam_([Update(value, gradient, mean, square, (1.0, *group.betas, group.epsilon, number))])
        longest = max(longest, (value - before).abs().item())
    return longest


def test_a_shorter_memory_makes_shorter_steps_after_a_jump():
    assert longest_step(RingLightRingRecipe(field_beta2=0.99)) < 2.5
    assert longest_step(RingLightRingRecipe(field_beta2=0.999)) > 5


@pytest.mark.parametrize("beta2", [-0.1, 1.0, float("nan")])
def test_a_memory_that_never_ends_is_refused(beta2: float):
    with pytest.raises(RecipeError, match="field_beta2"):
        RingLightRingRecipe(field_beta2=beta2)
