"""What every method must do, parametrised over the table and the plugs: from a scene to a file and back."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from contracts.methods import TRAINED, small
from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.fit.train import Training, train
from ringlight.methods.recipe import Recipe, recipe_from_dict, recipe_to_dict
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.models.contract import Model
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS, HALF = 24, 11
SAME = 2e-5
"""Of colours: sums over Gaussians of equal depth come in another order."""

pytestmark = [pytest.mark.parametrize("name", TRAINED)]


def training_of(name: str, seed: int = 3) -> tuple[Training, Scene]:
    scene = tiny_scene(views=6, size=24)
    return small(name, STEPS).build(scene, rasterizer_for("auto"), seed), scene


def bits(state: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in state.items()}


def same(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def shown(model: Model, scene: Scene, want: Want = Want.EXACT) -> Tensor:
    return model.render(scene.test[0].camera, scene.background_color, want).color


def test_it_is_a_recipe_that_goes_through_json(name: str):
    recipe = TRAINED[name]
    assert isinstance(recipe, Recipe)
    assert recipe_from_dict(type(recipe), _as_json(recipe_to_dict(recipe))) == recipe
    settled, _ = recipe.settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert settled.settled(tiny_scene(), rasterizer_for("auto"), 0)[0] == settled


def test_it_knows_what_it_may_settle_on(name: str):
    """Tables take a run for theirs by it."""
    asked = TRAINED[name]
    settled, _ = asked.settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert asked.may_settle_on(settled)
    assert asked.may_settle_on(settled.ending_with(77))
    assert settled.may_settle_on(settled)
    longer: Any = settled
    assert not asked.may_settle_on(dataclasses.replace(longer, steps=settled.steps + 1))
    assert not any(asked.may_settle_on(other) for other in TRAINED.values() if type(other) is not type(asked))


def _as_json(values: object) -> object:
    if isinstance(values, dict):
        return {key: _as_json(value) for key, value in values.items()}
    return [_as_json(value) for value in values] if isinstance(values, tuple) else values


def test_every_parameter_is_trained_and_stays_finite(name: str, monkeypatch: pytest.MonkeyPatch):
    """By the optimizer's steps, which nothing but gradients move; density control changes rows in between."""
    training, _ = training_of(name)
    model, step = training.model, training.optimizer.step
    moved: set[str] = set()

    def watched(*arguments: Any) -> str | None:
        before = bits(dict(model.named_parameters()))
        fault = step(*arguments)
        moved.update(n for n, value in model.named_parameters() if not torch.equal(value, before[n]))
        return fault

    monkeypatch.setattr(training.optimizer, "step", watched)
    for progress in train(training):
        assert progress.fault is None
        for parameter, value in model.named_parameters():
            assert value.isfinite().all(), parameter
    # The harmonics' higher degrees are a column; a column that is there moves.
    assert moved == {parameter for parameter, _ in model.named_parameters()}
    for parameter in moved:
        assert training.optimizer.moments[f"mean.{parameter}"].any(), parameter


def test_a_stopped_run_goes_on_with_the_same_bits(name: str):
    whole, _ = training_of(name)
    halfway: dict[str, Tensor] = {}
    for progress in train(whole):
        if progress.step == HALF:
            halfway = bits(whole.state())
    resumed, _ = training_of(name)
    resumed.restore(halfway)
    assert [progress.step for progress in train(resumed)] == list(range(HALF + 1, STEPS + 1))
    assert same(whole.state(), resumed.state())


def test_nothing_depends_on_who_looks(name: str):
    """Nor on torch's ambient switch."""
    ends = []
    for ambient, looks in ((torch.enable_grad, False), (torch.no_grad, True)):
        training, scene = training_of(name)
        with ambient():
            for _ in train(training):
                if looks:
                    shown(training.model, scene, Want.PICTURE)
        ends.append(bits(training.state()))
    assert same(*ends)


def test_gradients_and_exact_pictures_have_the_same_bits(name: str):
    training, scene = training_of(name)
    for _ in train(training):
        pass
    camera, behind = scene.test[0].camera, scene.background_color
    for ambient in (torch.no_grad, torch.enable_grad):
        with ambient():
            with_way, exact = (training.model.render(camera, behind, want) for want in (Want.GRADIENTS, Want.EXACT))
        assert torch.equal(with_way.color, exact.color)
        assert torch.equal(with_way.alpha, exact.alpha)
        assert with_way.buffers.keys() == exact.buffers.keys()
    with pytest.raises(RuntimeError, match="no way back"):
        exact.backward(torch.zeros_like(exact.color), {})


def test_a_file_holds_all_that_shows(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe = small(name, STEPS)
    monkeypatch.setitem(METHODS, name, TRAINED[name])
    training, scene = training_of(name)
    for _ in train(training):
        pass
    path = tmp_path / "model.safetensors"
    header = model_header(name, recipe, training.step, scene_facts(scene))
    save_model(path, training.model, header, [view.camera for view in scene.train])
    stored = load_model(path, rasterizer_for("auto"))
    assert torch.equal(shown(stored.model, scene), shown(training.model, scene))
    counted, size = training.model.rendering_size()
    assert stored.model.counted() == counted
    assert size == sum(t.numel() * t.element_size() for t in training.model.rendering_tensors().values())
    again = tmp_path / "again.safetensors"
    save_model(again, stored.model, stored.header, stored.cameras)
    assert again.read_bytes() == path.read_bytes()


def test_the_order_of_rows_changes_nothing(name: str):
    training, scene = training_of(name)
    model = training.model
    prefixes = model.row_prefixes
    if not prefixes:
        pytest.skip("no rows that could be shuffled")
    before = shown(model, scene)
    order = torch.randperm(model.counted().number, generator=torch.Generator().manual_seed(1))
    state = {n: t[order] if n.startswith(prefixes) else t for n, t in bits(model.state_dict()).items()}
    model.load_tensors(state)
    torch.testing.assert_close(shown(model, scene), before, rtol=0, atol=SAME)


def test_layers_have_names_and_a_picture_each(name: str):
    training, scene = training_of(name)
    camera = scene.test[0].camera
    layers = training.model.layers(camera)
    assert {"alpha", "depth", "normal", "residual"} <= layers.keys()
    assert all(layer.shape[:2] == (camera.height, camera.width) for layer in layers.values())
    assert all(layer.isfinite().all() for layer in layers.values())


def test_bounds_are_asked_of_the_recipe(name: str):
    recipe = small(name, STEPS)
    assert recipe.ending_with(recipe.most) == recipe
    bounded = recipe.ending_with(77)
    assert bounded.most in (77, None)
    assert (bounded.most is None) == (bounded == recipe)
    assert dataclasses.is_dataclass(recipe.never_above(1000))
