"""The loop: it learns, it stops when nobody asks, and a restored run gives the same bits."""

import dataclasses

import pytest
import torch

from ringlight.data.synthetic import tiny_scene
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.train import direct_model, train
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for

QUICK = DensifySettings(threshold=1e-5, begin=4, every=5, stop=0.8, reset_every=12, max_gaussians=900)


def quick(method: str, steps: int = 30):
    recipe = dataclasses.replace(METHODS[method], steps=steps, densify=QUICK)
    if isinstance(recipe, RingLightRecipe):
        ring = dataclasses.replace(
            recipe.light.ring, rank=4, features=6, head_hidden=8, position_nodes=16, view_nodes=4
        )
        light = dataclasses.replace(recipe.light, ring=ring, render_hidden=8, modulation_hidden=8)
        recipe = dataclasses.replace(recipe, light=light, shading="forward")
    return recipe


@pytest.mark.parametrize("visible_only", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_a_restored_run_goes_on_with_the_same_bits(method: str, visible_only: bool):
    scene, rasterize = tiny_scene(), rasterizer_for("auto")
    recipe = dataclasses.replace(quick(method), visible_only=visible_only)
    whole = recipe.build(scene, rasterize, seed=3)
    saved = None
    for progress in train(whole):
        if progress.step == 17:
            saved = {name: tensor.clone() for name, tensor in whole.state().items()}
    assert saved is not None
    resumed = recipe.build(scene, rasterize, seed=3)
    resumed.restore(saved)
    assert [progress.step for progress in train(resumed)] == list(range(18, 31))
    end, again = whole.state(), resumed.state()
    assert end.keys() == again.keys()
    assert all(torch.equal(end[name], again[name]) for name in end)


@pytest.mark.parametrize("method", METHODS)
def test_same_seed_same_bits_and_another_seed_another_run(method: str):
    def end(seed: int) -> dict[str, torch.Tensor]:
        training = quick(method, steps=8).build(tiny_scene(), rasterizer_for("auto"), seed)
        for _ in train(training):
            pass
        return training.state()

    first, second, other = end(1), end(1), end(2)
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert any(first[name].shape != other[name].shape or not torch.equal(first[name], other[name]) for name in first)


def test_training_is_paused_by_not_asking():
    training = quick("3dgs").build(tiny_scene(), rasterizer_for("auto"), seed=0)
    steps = train(training)
    assert next(steps).step == 1
    assert next(steps).step == 2
    assert training.step == 2


def test_the_loss_shown_is_the_sum_of_its_terms():
    recipe = dataclasses.replace(quick("ringlight"), mask_penalty=0.1)
    training = recipe.build(tiny_scene(), rasterizer_for("auto"), seed=0)
    progress = next(train(training))
    assert set(progress.losses) == {"photometric", "mask"}
    assert progress.loss == pytest.approx(sum(term.item() for term in progress.losses.values()))


@pytest.mark.parametrize("constant", [False, True])
def test_a_penalty_counts_whether_or_not_it_has_a_gradient(constant: bool):
    def scales(model):
        term = model.columns["log_scales"].exp().mean()
        return term.detach() if constant else term

    def after_one_step(penalties):
        training = quick("3dgs").build(tiny_scene(), rasterizer_for("auto"), seed=0)
        training.penalties = penalties
        return next(train(training)), training.model.columns["log_scales"]

    plain, without = after_one_step({})
    progress, with_penalty = after_one_step({"scales": scales})
    assert progress.loss > plain.loss
    assert torch.equal(with_penalty, without) is constant


def test_the_light_field_waits_for_the_warm_up():
    recipe = dataclasses.replace(quick("ringlight"), warmup=0.1)  # of 30 steps
    training = recipe.build(tiny_scene(), rasterizer_for("auto"), seed=0)
    before = {n: t.clone() for n, t in training.model.named_parameters() if n.startswith("color.")}
    steps = train(training)
    for _ in range(3):
        next(steps)
    assert all(torch.equal(dict(training.model.named_parameters())[n], t) for n, t in before.items())
    next(steps)
    assert any(not torch.equal(dict(training.model.named_parameters())[n], t) for n, t in before.items())


@pytest.mark.parametrize("visible_only", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_without_autograd_the_same_bits(method: str, visible_only: bool):
    recipe = dataclasses.replace(quick(method, steps=40), visible_only=visible_only)
    ends = []
    for direct in (True, False):
        training = recipe.build(tiny_scene(), rasterizer_for("auto"), seed=5)
        losses = [progress.loss for progress in train(training, direct)]
        ends.append(training.state() | {"losses": torch.tensor(losses)})
    assert all(torch.equal(ends[0][name], ends[1][name]) for name in ends[1])


@pytest.mark.parametrize("change", [{"parallax": False}, {"parallax": False, "axis_nodes": 0}, {"latents": 0}])
def test_without_autograd_the_same_bits_whatever_the_shader_looks_at(change: dict[str, object]):
    preset = METHODS["ringlight-mirror"]
    shader = dataclasses.replace(preset.shader, levels=(9, 5), hidden=8, **change)
    recipe = dataclasses.replace(preset, steps=8, shader=shader)
    ends = []
    for direct in (True, False):
        training = recipe.build(tiny_scene(views=3, size=24), rasterizer_for("auto"), seed=5)
        assert direct_model(training) is not None
        for _ in train(training, direct):
            pass
        assert training.model.get_buffer("shader.lit")
        ends.append(training.state())
    assert all(torch.equal(ends[0][name], ends[1][name]) for name in ends[1])


def test_harmonics_are_trained_without_autograd_on_the_cpu():
    assert direct_model(quick("3dgs").build(tiny_scene(), rasterizer_for("cpu"), seed=0)) is not None
    assert direct_model(quick("3dgs").build(tiny_scene(), rasterizer_for("reference"), seed=0)) is None
