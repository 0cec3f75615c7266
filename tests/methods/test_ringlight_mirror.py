"""The recipe's parts: an opaque surface at once, the shader later, and a bound on the number of Gaussians."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.data import hull
from ringlight.errors import RecipeError
from ringlight.fit.train import train
from ringlight.methods.mirror_bounds import most_gaussians
from ringlight.methods.mirror_course import DECAY
from ringlight.methods.relight_recipe import relight_recipe
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from ringlight.shade.reflection_settings import FINE_LEVELS, USUAL_LEVELS
from tiny_scene import tiny_scene

RECIPE = RingLightMirrorRecipe(steps=20, warmup=0.5)


@pytest.fixture(autouse=True)
def small_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hull, "FINE_CELLS", 48)


def test_training_begins_opaque_and_unlit_and_within_the_bound():
    scene = tiny_scene(views=4, size=48)
    training = RECIPE.build(scene, rasterizer_for("auto"), seed=0)
    table = training.model.gaussians
    torch.testing.assert_close(table.opacities, torch.full((len(table),), RECIPE.opacity))
    assert len(table) == math.ceil(RECIPE.start_share * most_gaussians(48 * 48, 1))
    view = scene.train[0]
    rendering = training.model.render(view.camera, scene.background_color)
    assert torch.equal(rendering.color, rendering.buffers["rgb"])
    mask = torch.from_numpy(view.load()[..., 3:] > 250)
    assert rendering.alpha[mask].mean() > 0.9


def test_the_shader_is_switched_on_after_the_warm_up_and_learns():
    training = RECIPE.build(tiny_scene(views=4, size=24), rasterizer_for("auto"), seed=0)
    before = {name: value.detach().clone() for name, value in training.model.shader.named_parameters()}
    for progress in train(training):
        assert bool(training.model.get_buffer("shader.lit")) == (progress.step >= 10)
    assert all(not torch.equal(value, before[name]) for name, value in training.model.shader.named_parameters())


def test_it_settles_on_maps_as_fine_as_suit_the_photographs():
    rasterize = rasterizer_for("auto")
    found = {size: RECIPE.settled(tiny_scene(views=1, size=size), rasterize, 0)[0] for size in (24, 320)}
    assert [recipe.shader.levels for recipe in found.values()] == [USUAL_LEVELS, FINE_LEVELS]
    assert all(RECIPE.may_settle_on(recipe) for recipe in found.values())
    scene = tiny_scene(views=1, size=320)
    uneven = dataclasses.replace(scene, train=tuple(without_even_border(view) for view in scene.train))
    assert RECIPE.settled(uneven, rasterize, 0)[0].shader.levels == USUAL_LEVELS, "nothing cuts the subject out"
    given = dataclasses.replace(RECIPE, shader=dataclasses.replace(RECIPE.shader, levels=USUAL_LEVELS))
    assert [given.may_settle_on(recipe) for recipe in found.values()] == [True, False]
    shader = found[320].parts(tiny_scene().box)[1]
    assert [level.shape[0] for level in shader.maps[0].levels] == list(FINE_LEVELS)


def test_the_light_keeps_its_rates_while_the_normals_settle():
    for hold, kept in ((0.75, 1.0), (0.0, DECAY**0.7)):
        groups = dataclasses.replace(RECIPE, light_hold=hold).course(tiny_scene()).groups
        lit = {"shader.maps.*", "shader.mlp.*", "columns.latents", "columns.basis_weights", "color.varying.basis"}
        for name in (*lit, "columns.normals"):
            rate, share = groups[name].rate, DECAY**0.7 if name == "columns.normals" else kept
            assert rate.at(0.7) == pytest.approx(share * rate.at(0.0))
            assert rate.at(1.0) == pytest.approx(DECAY * rate.at(0.0))
    with pytest.raises(RecipeError, match="light_hold is 1; give a share"):
        dataclasses.replace(RECIPE, light_hold=1.0)


def test_what_moves_opacities_is_learned_in_training_and_still_when_relit():
    name, scene = "color.varying.opacity_basis", tiny_scene()
    slow = dataclasses.replace(RECIPE, opacity_basis_rate=1e-3)
    rate = slow.course(scene).groups[name].rate
    assert (rate.at(0.0), rate.at(1.0)) == pytest.approx((1e-3, DECAY * 1e-3))
    assert relight_recipe(RECIPE, 300).course(scene).groups[name].rate.at(0.0) == 0
    constant = dataclasses.replace(RECIPE, varying_opacity=False)
    assert name not in constant.course(scene).groups
    assert constant.without_effect()["opacity_basis_rate"] == "--no-varying-opacity is given"
    before = dataclasses.replace(constant, opacity_basis_rate=4e-2)
    relit = relight_recipe(before, 300)
    assert relight_recipe(relit, 300) == relit
    assert relit.opacity_basis_rate == 4e-2, "as records state it whose opacities do not vary"


@pytest.mark.parametrize("steps", [3_000, 30_000])
def test_a_relit_basis_learns_as_fast_whatever_the_model_was_trained_for(steps: int):
    relit = relight_recipe(dataclasses.replace(RECIPE, steps=steps).at_length(), 300)
    assert (relit.weights_rate, relit.basis_rate) == (0.0, 1e-2)
    assert relight_recipe(relit, 300) == relit
    still = dataclasses.replace(RECIPE, basis_size=0, weights_rate=0.0)
    assert relight_recipe(still, 300).weights_rate == 0.0


@pytest.mark.parametrize(("steps", "weights"), [(3_000, 5e-3), (7_000, 5e-3), (30_000, 3e-4), (90_000, 3e-4)])
def test_weights_learn_more_slowly_in_long_runs(steps: int, weights: float):
    decided = dataclasses.replace(RECIPE, steps=steps).at_length()
    rates = (weights, 2 * weights, 8 * weights)
    assert (decided.weights_rate, decided.basis_rate, decided.opacity_basis_rate) == pytest.approx(rates)
    groups = decided.course(tiny_scene()).groups
    names = ("columns.basis_weights", "color.varying.basis", "color.varying.opacity_basis")
    assert [groups[name].rate.at(0.0) for name in names] == pytest.approx(rates)
    between = dataclasses.replace(RECIPE, steps=15_000).at_length()
    assert 3e-4 < (between.weights_rate or 0) < 5e-3
    said = dataclasses.replace(RECIPE, steps=steps, basis_rate=1e-4).at_length()
    assert (said.weights_rate, said.opacity_basis_rate) == pytest.approx((weights, 4e-4))


@pytest.mark.parametrize(
    ("steps", "unlit"), [(10, 1), (20, 1), (1_000, 50), (3_000, 150), (4_231, 150), (7_000, 150), (30_000, 150)]
)
def test_base_colours_alone_are_shown_for_150_steps_at_most(steps: int, unlit: int):
    usual = RingLightMirrorRecipe(steps=steps)
    decided = usual.at_length()
    assert decided.warmup is not None
    assert decided.first_lit == usual.first_lit == unlit
    assert decided.at_length() == decided
    assert dataclasses.replace(usual, warmup=0.5).at_length().first_lit == steps // 2
    assert dataclasses.replace(usual, warmup=0.0).at_length().warmup == 0.0
    assert usual.may_settle_on(decided)
    assert not usual.may_settle_on(dataclasses.replace(decided, warmup=0.3))


def test_where_nothing_is_cut_out_a_tenth_of_the_run_shows_base_colours_alone():
    scene = tiny_scene(views=4, size=24)
    opaque = dataclasses.replace(scene, train=tuple(without_even_border(view) for view in scene.train))
    usual = RingLightMirrorRecipe(steps=4_000)
    (carved, _), (uncarved, _) = (usual.settled(each, rasterizer_for("auto"), 0) for each in (scene, opaque))
    assert (carved.first_lit, uncarved.first_lit) == (150, 400)
    assert usual.may_settle_on(carved)
    assert usual.may_settle_on(uncarved)
    chooser = RingLightRecipe(steps=4_000, shading="mirror")
    assert chooser.settled(opaque, rasterizer_for("auto"), 0) == (uncarved, None)
    assert chooser.may_settle_on(uncarved)
    asked = dataclasses.replace(usual, warmup=0.02)
    assert asked.settled(opaque, rasterizer_for("auto"), 0)[0].warmup == 0.02
    assert not asked.may_settle_on(uncarved)


def test_what_decides_nothing_is_left_open():
    constant = dataclasses.replace(RECIPE, varying_opacity=False).at_length()
    assert constant.opacity_basis_rate is None
    still = dataclasses.replace(RECIPE, basis_size=0).at_length()
    assert (still.weights_rate, still.basis_rate, still.opacity_basis_rate) == (None, None, None)


def test_normals_are_asked_to_agree_with_depths_when_the_light_begins():
    scene = tiny_scene(views=4, size=24)
    settings = {"consistency": 0.2, "consistency_every": 2, "consistency_until": 0.4, "warmup": 0.2}
    recipe = dataclasses.replace(RECIPE, **settings)
    training = recipe.build(scene, rasterizer_for("auto"), seed=0)
    asked = [progress.step for progress in train(training) if "consistency" in progress.losses]
    assert asked == [6, 8], "step 4 switches the light on; until then nothing else moves normals"
    assert "no step is lit" in dataclasses.replace(recipe, warmup=0.4).without_effect()["consistency"]
    training.extend(20)
    assert "consistency" not in training.regularizers_at(24)
    assert "consistency" not in relight_recipe(RECIPE, 300).course(scene).regularizers
    without = dataclasses.replace(RECIPE, consistency=0.0)
    assert not without.course(scene).regularizers
    assert without.without_effect()["consistency_every"] == "--consistency is 0"
    for name, value in {"consistency": -1.0, "consistency_every": 0, "consistency_until": 1.5}.items():
        with pytest.raises(RecipeError, match=f"{name} is {value:g}; give"):
            dataclasses.replace(RECIPE, **{name: value})


def test_where_no_hull_cuts_the_subject_out_there_may_be_three_gaussians_for_four_pixels():
    scene = tiny_scene(views=2, size=130)
    opaque = dataclasses.replace(scene, train=tuple(without_mask(view) for view in scene.train))
    bounds = [bound(RECIPE, each) for each in (scene, opaque)]
    assert bounds == [most_gaussians(scene.pixels, len(scene.train)), math.ceil(0.75 * scene.pixels)]
    assert bounds[0] < bounds[1]
    asked = dataclasses.replace(RECIPE, densify=dataclasses.replace(RECIPE.densify, max_gaussians=1234))
    assert bound(asked, opaque) == 1234


def bound(recipe: RingLightMirrorRecipe, scene: Scene) -> int:
    strategies = recipe.build(scene, rasterizer_for("auto"), seed=0).strategies
    return next(strategy.most for strategy in strategies if strategy.most is not None)


def without_even_border(view: View) -> View:
    ramp = np.arange(view.load().size // 4, dtype=np.uint8).reshape(view.load().shape[:2])
    return dataclasses.replace(view, load=lambda: np.stack([ramp] * 3, -1), has_alpha=False)


def without_mask(view: View) -> View:
    return dataclasses.replace(view, load=lambda: view.load()[..., :3].copy(), has_alpha=False)


def test_same_seed_same_bits():
    scene = tiny_scene(views=4, size=24)
    runs = []
    for _ in range(2):
        training = RECIPE.build(scene, rasterizer_for("auto"), seed=7)
        for _ in train(training):
            pass
        runs.append(training.model.state_dict())
    assert all(torch.equal(runs[0][name], runs[1][name]) for name in runs[0])


def test_a_model_file_renders_the_same(tmp_path: Path):
    scene = tiny_scene(views=4, size=24)
    training = RECIPE.build(scene, rasterizer_for("auto"), seed=0)
    for _ in train(training):
        pass
    cameras = [view.camera for view in scene.train]
    header = model_header("ringlight-mirror", RECIPE, 20, scene_facts(scene))
    save_model(tmp_path / "model.safetensors", training.model, header, cameras)
    stored = load_model(tmp_path / "model.safetensors", rasterizer_for("auto"))
    for camera in cameras:
        with torch.no_grad():
            expected = training.model.render(camera, scene.background_color).color
            assert torch.equal(stored.model.render(camera, scene.background_color).color, expected)
    layers = stored.model.layers(cameras[0])
    assert {"base", "residual", "normal", "depth", "alpha"} <= set(layers)
    assert layers["residual"].abs().max() > 0


@pytest.mark.parametrize(
    ("setting", "value"), [("warmup", 1.5), ("opacity", 1.0), ("start_share", 0.0), ("normals_rate", -1.0)]
)
def test_settings_out_of_range_are_named(setting: str, value: float):
    with pytest.raises(RecipeError, match=setting):
        dataclasses.replace(RECIPE, **{setting: value})


def test_settings_of_the_basis_have_no_effect_where_there_is_none():
    idle = {"sh_every", "weights_rate", "basis_rate"}
    assert not idle & set(RECIPE.without_effect())
    constant = dataclasses.replace(RECIPE, basis_size=0).without_effect()
    assert {name: constant.get(name) for name in idle} == dict.fromkeys(idle, "--basis-size is 0")
