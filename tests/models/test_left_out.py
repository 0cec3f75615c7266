"""A training picture without some of the Gaussians, and the way back from it."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight.core.gradients import COLUMNS, dense
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.data.dropout import LeftOut
from ringlight.errors import RecipeError
from ringlight.fit.train import Training, train
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.reference import ReferenceRasterizer
from small_recipes import COARSE, with_settings
from tiny_scene import tiny_scene

SHARE = 0.4

METHODS_WITH_IT = ["3dgs", "ringlight-basis"]

STEPS = 40

OPAQUE = 9.0
"""A logit whose opacity is more than one when others are left out."""


def trained(method: str, steps: int = STEPS, **settings: object) -> Training:
    """With light that has learned something: a method's first weights are zero."""
    recipe = with_settings(METHODS[method], COARSE | {"steps": STEPS, **settings})
    training = recipe.build(tiny_scene(views=8, size=48), rasterizer_for("cpu"), seed=1)
    for progress in train(training):
        if progress.step == steps:
            break
    return training


def predicted(model: SplatModel, batch: ImageBatch) -> tuple[Tensor, dict[str, Tensor]]:
    rendering = model.predict(batch, Want.GRADIENTS)
    upstream = torch.linspace(-1, 1, rendering.color.numel()).reshape(rendering.color.shape)
    return rendering.color, {name: dense(found) for name, found in rendering.backward(upstream, {}).items()}


def without_some(training: Training) -> ImageBatch:
    batch = training.batches.at(3)
    assert isinstance(batch, ImageBatch)
    return dataclasses.replace(batch, left_out=LeftOut(SHARE, seed=2, step=3))


@pytest.mark.parametrize("method", METHODS_WITH_IT)
def test_the_kernels_give_what_the_reference_gives(method: str):
    training = trained(method)
    model, batch = training.model, without_some(training)
    assert isinstance(model, SplatModel)
    with torch.no_grad():
        model.columns["opacity_logits"][::2] += OPAQUE
    color, gradients = predicted(model, batch)
    model.rasterize = ReferenceRasterizer()
    expected, slow = predicted(model, batch)
    assert (color - expected).abs().max() < 1e-4
    assert gradients.keys() == slow.keys()
    for name, gradient in slow.items():
        assert (gradients[name] - gradient).abs().max() <= 2e-3 * gradient.abs().max() + 1e-6, name


def test_it_is_the_picture_of_the_others_with_more_opacity():
    training = trained("3dgs")
    model, batch = training.model, without_some(training)
    assert isinstance(model, SplatModel)
    assert batch.left_out is not None
    kept = batch.left_out.factors(len(model), model.device) > 0
    color, gradients = predicted(model, batch)
    columns = {name: column.detach()[kept] for name, column in model.columns.items()}
    opacities = columns["opacity_logits"].sigmoid() / (1 - SHARE)
    model.load_columns(columns | {"opacity_logits": opacities.clamp_max(1 - 1e-6).logit()})
    expected, of_others = predicted(model, dataclasses.replace(batch, left_out=None))
    assert (color - expected).abs().max() < 1e-3
    for name in ("means", "sh_dc"):
        assert not gradients[COLUMNS + name][~kept].any()
        difference = gradients[COLUMNS + name][kept] - of_others[COLUMNS + name]
        assert difference.abs().max() < 1e-2 * of_others[COLUMNS + name].abs().max()


@pytest.mark.parametrize("method", METHODS_WITH_IT)
def test_it_begins_in_the_second_half_of_a_run(method: str):
    half, none = (trained(method, STEPS // 2, dropout=share).state() for share in (0.3, 0.0))
    assert all(torch.equal(half[name], tensor) for name, tensor in none.items())
    after = [trained(method, STEPS // 2 + 1, dropout=share).state()["model.columns.means"] for share in (0.3, 0.0)]
    assert not torch.equal(*after)


@pytest.mark.parametrize("method", METHODS_WITH_IT)
@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_nothing_that_leaves_no_picture_is_taken(method: str, share: float):
    with pytest.raises(RecipeError, match=r"^dropout is .*; give a share from 0 \(none\) to less than 1$"):
        dataclasses.replace(METHODS[method], dropout=share)


@pytest.mark.parametrize("method", METHODS_WITH_IT)
def test_a_run_that_stops_among_such_pictures_goes_on_with_the_same_bits(method: str):
    whole, resumed = (trained(method, steps, dropout=0.3) for steps in (STEPS, STEPS // 2 + 3))
    again = trained(method, 1, dropout=0.3)
    again.restore(resumed.state())
    for _ in train(again):
        pass
    assert all(torch.equal(again.state()[name], tensor) for name, tensor in whole.state().items())
