"""What recipes of volumes have in common."""

import pytest

from ringlight.errors import RecipeError
from ringlight.fit.train import train
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.methods.volume_recipe import COLD, VolumeRecipe
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene

both = pytest.mark.parametrize("recipe", [PuttRecipe, TensorfRecipe])


@both
@pytest.mark.parametrize(("steps", "rising"), [(30_000, 200), (3000, 200), (600, 40), (15, 1)])
def test_the_networks_rate_rises_over_200_steps_or_a_fifteenth(recipe: type[VolumeRecipe], steps: int, rising: int):
    rate = recipe(steps=steps, network_rate=1.0).groups()["*"].rate
    assert rate.at(0.0) == pytest.approx(COLD)
    assert rate.at(rising / steps / 2) == pytest.approx(COLD**0.5)
    assert rate.at(rising / steps) == pytest.approx(1.0)


@both
def test_it_rises_over_the_share_that_is_given_or_not_at_all(recipe: type[VolumeRecipe]):
    half = recipe(steps=30_000, network_rate=1.0, network_warm_up=0.5).groups()["*"].rate
    assert half.at(0.25) == pytest.approx(COLD**0.5)
    assert recipe(steps=30_000, network_rate=1.0, network_warm_up=0.0).groups()["*"].rate.at(0.0) == pytest.approx(1.0)


@both
def test_networks_of_older_recipes_begin_at_their_full_rate(recipe: type[VolumeRecipe]):
    written = recipe_to_dict(recipe())
    assert written.pop("network_warm_up") is None
    older = recipe_from_dict(recipe, written)
    assert older.network_warm_up == 0
    assert older.groups()["*"].rate.at(0.0) == pytest.approx(older.network_rate)


@both
@pytest.mark.parametrize(("share", "said"), [(1.0, "1"), (-0.1, "-0.1"), (float("nan"), "nan")])
def test_shares_that_cannot_be_are_refused(recipe: type[VolumeRecipe], share: float, said: str):
    with pytest.raises(RecipeError, match=f"^network_warm_up is {said}; give 0 \\(none\\) to below 1$"):
        recipe(network_warm_up=share)


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_the_reference_marches_in_torch_where_it_was_asked_for(method: str):
    scene, losses = tiny_scene(views=6, size=20), {}
    for device, renderer in (("cpu", "cpu ray marcher"), ("reference", "ray marcher in torch")):
        training = small(method, gradient_share=1.0).build(scene, rasterizer_for(device), 3)
        assert training.model.renderer == renderer
        losses[device] = next(train(training)).loss
    assert losses["reference"] == pytest.approx(losses["cpu"], rel=1e-3)
