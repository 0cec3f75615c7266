"""The loop: it learns, it stops when nobody asks, and a restored run gives the same bits."""

import dataclasses

import pytest
import torch

from ringlight.core.gradients import Gradients, dense
from ringlight.core.rendering import Footprint
from ringlight.fit.regularizers.by_torch import TorchRegularizer
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.shade.reflection import ReflectionShader
from small_recipes import SPLATS, TRAINED, small, with_settings
from tiny_scene import tiny_scene

QUICK = DensifySettings(threshold=1e-5, begin=4, every=5, stop=0.8, reset_every=12, max_gaussians=900)


def quick(method: str, steps: int = 30):
    return small(method, steps=steps, densify=QUICK)


@pytest.mark.parametrize("visible_only", [False, True])
@pytest.mark.parametrize("method", TRAINED)
def test_a_restored_run_goes_on_with_the_same_bits(method: str, visible_only: bool):
    scene, rasterize = tiny_scene(), rasterizer_for("auto")
    recipe = with_settings(quick(method), {"visible_only": visible_only})
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


@pytest.mark.parametrize("method", TRAINED)
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
    recipe = dataclasses.replace(quick("ringlight-ring"), mask_penalty=0.1)
    training = recipe.build(tiny_scene(), rasterizer_for("auto"), seed=0)
    progress = next(train(training))
    assert set(progress.losses) == {"photometric", "mask"}
    assert progress.loss == pytest.approx(sum(term.item() for term in progress.losses.values()))


def test_the_light_field_waits_for_the_warm_up():
    recipe = dataclasses.replace(quick("ringlight-ring"), warmup=0.1)  # of 30 steps
    training = recipe.build(tiny_scene(), rasterizer_for("auto"), seed=0)
    before = {n: t.clone() for n, t in training.model.named_parameters() if n.startswith("color.")}
    steps = train(training)
    for _ in range(3):
        next(steps)
    assert all(torch.equal(dict(training.model.named_parameters())[n], t) for n, t in before.items())
    next(steps)
    assert any(not torch.equal(dict(training.model.named_parameters())[n], t) for n, t in before.items())


@pytest.mark.parametrize("change", [{}, {"parallax": False}, {"parallax": False, "axis_nodes": 0}, {"latents": 0}])
def test_a_step_has_the_same_bits_whether_tiles_are_shaded_or_planes(change: dict[str, object], monkeypatch):
    preset = METHODS["ringlight-mirror"]
    shader = dataclasses.replace(preset.shader, levels=(9, 5), hidden=8, **change)
    recipe = dataclasses.replace(preset, steps=8, shader=shader)
    ends = []
    for without_tiles in (False, True):
        if without_tiles:
            monkeypatch.setattr(ReflectionShader, "tiles", lambda *_: None)
        training = recipe.build(tiny_scene(views=3, size=24), rasterizer_for("auto"), seed=5)
        for _ in train(training):
            pass
        assert training.model.get_buffer("shader.lit")
        ends.append(training.state())
    assert all(torch.equal(ends[0][name], ends[1][name]) for name in ends[1])


@pytest.mark.parametrize("method", SPLATS)
def test_what_reduces_sees_every_gradient_and_adam_gets_what_it_returns(method: str):
    """As two processes would: theirs is ours, and so the sum is twice each."""
    asked: list[tuple[Gradients, Gradients]] = []

    def twice(gradients: Gradients) -> Gradients:
        both = Gradients({name: 2 * dense(gradient) for name, gradient in gradients.items()})
        asked.append((gradients, both))
        return both

    training = dataclasses.replace(quick(method, steps=30).build(tiny_scene(), rasterizer_for("auto"), 0), reduce=twice)
    training.regularizers = {"opaque": TorchRegularizer(faint, ("columns.opacity_logits",))}
    given: list[Gradients] = []
    step = training.optimizer.step

    def noted(number: int, gradients: Gradients, footprint: Footprint | None = None) -> str | None:
        given.append(gradients)
        return step(number, gradients, footprint)

    training.optimizer.step = noted
    for progress in train(training):
        gradients, both = asked[-1]
        assert given[-1] is both
        assert len(asked) == progress.step
        if progress.step == 1:
            opacity = dense(gradients["columns.opacity_logits"])
    assert asked[-1][0].keys() == {
        name for name, _ in training.model.named_parameters() if name in asked[-1][0] or not name.startswith("columns.")
    }
    plain = quick(method, steps=30).build(tiny_scene(), rasterizer_for("auto"), seed=0)
    plain.regularizers = {}
    first: list[Gradients] = []
    plain.reduce = lambda gradients: first.append(gradients) or gradients
    model = plain.model
    leaf = model.get_parameter("columns.opacity_logits").detach().clone().requires_grad_()
    (of_term,) = torch.autograd.grad(faint({"columns.opacity_logits": leaf}), leaf)
    next(train(plain))
    torch.testing.assert_close(opacity, dense(first[0]["columns.opacity_logits"]) + of_term)


def faint(tensors: dict[str, torch.Tensor]) -> torch.Tensor:
    """A regularizer's term: 3 times the mean opacity."""
    return 3 * tensors["columns.opacity_logits"].sigmoid().mean()
