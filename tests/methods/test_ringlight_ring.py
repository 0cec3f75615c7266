"""How the light field's Adam bears the jumps that density control makes of its gradients is a setting."""

from pathlib import Path

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_
from ringlight.fit.train import train
from ringlight.methods.recipe import recipe_to_dict
from ringlight.methods.ringlight_ring import PAPER, RingLightRingRecipe
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small, with_settings
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


def test_the_preset_takes_the_paper_at_its_word():
    """Every number that the paper states, and 3DGS's where it takes "the default settings"."""
    ring, light = PAPER.light.ring, PAPER.light
    assert (ring.rank, ring.features, ring.bands, ring.view_bands, ring.head_hidden) == (16, 48, 10, 10, 128)
    assert ring.core == "network"
    assert (light.render_hidden, light.latents, light.mask, light.base_color) == (128, 0, True, True)
    assert (light.light_modulation, light.modulation_as, light.clamp_colors) == (True, "input", False)
    assert (PAPER.steps, PAPER.warmup, PAPER.field_rate, PAPER.field_rate_end) == (30_000, 0.1, 1e-4, 1e-4)
    assert (PAPER.loss.pixel, PAPER.loss.scale, PAPER.loss.ssim_weight) == ("l2", 1e4, 0.2)
    assert (PAPER.densify.threshold, PAPER.densify.drop_share, PAPER.densify.reset_every) == (1.1, 0.0, 3000)
    assert (PAPER.densify.pixel_bound, PAPER.densify.max_gaussians, PAPER.random_points) == (False, 0, 100_000)
    assert (PAPER.rates.means, PAPER.rates.scales, PAPER.rates.opacities, PAPER.rates.hold) == (1.6e-4, 5e-3, 0.05, 1)


def test_our_own_preset_is_none_of_that():
    ours = RingLightRingRecipe()
    assert (ours.light.ring.core, ours.light.clamp_colors) == ("free", True)
    assert (ours.densify.pixel_bound, ours.random_points, ours.rates.opacities) == (True, 0, 0.025)


@pytest.mark.parametrize("points", [-1, -100_000])
def test_fewer_points_than_none_are_refused(points: int):
    with pytest.raises(RecipeError, match="random_points"):
        RingLightRingRecipe(random_points=points)


OTHERWISE = {
    "factor": {"modulation_as": "factor", "clamp_colors": False},
    "network": {"ring": {"core": "network", "code_identity": False, "code_pi": False}},
    "positions": {"position_gradients": True},
}
"""Readings of the paper that neither preset takes together."""


@pytest.mark.parametrize("light", OTHERWISE.values(), ids=OTHERWISE)
def test_other_readings_train_and_are_read_back_from_a_file(light: dict[str, object], tmp_path: Path):
    recipe = with_settings(small("ringlight-ring", steps=6, warmup=0.3), {"light": light})
    scene = tiny_scene(views=4, size=16)
    training = recipe.build(scene, rasterizer_for("auto"), seed=0)
    for progress in train(training):
        assert progress.fault is None
    header = model_header("ringlight-ring", recipe, training.step, scene_facts(scene))
    save_model(tmp_path / "model.safetensors", training.model, header, [view.camera for view in scene.train])
    stored = load_model(tmp_path / "model.safetensors", rasterizer_for("auto"))
    camera, behind = scene.test[0].camera, scene.background_color
    shown, again = (model.render(camera, behind).color for model in (training.model, stored.model))
    assert torch.equal(shown, again)
    assert stored.header.recipe == recipe_to_dict(recipe)
