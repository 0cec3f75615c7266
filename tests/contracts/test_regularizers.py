"""What every regularizer must do, parametrised over all that are plugged in."""

import dataclasses
import importlib
import inspect
import pkgutil

import pytest
import torch
from torch import Tensor

from contracts.differences import TOLERANCE, slopes_differ
from contracts.methods import small
from contracts.plugged import REGULARIZERS
from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.errors import RecipeError
from ringlight.fit import regularizers
from ringlight.fit.regularizers.appearance_variation import AppearanceVariation
from ringlight.fit.regularizers.contract import Regularizer, Term
from ringlight.fit.train import Training
from ringlight.models.contract import Model
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene
from volume.volumes import volume_of_trains

ROWS = 12
"""Gaussians: the slope of a mean over hundreds would drown in the rounding of its value."""


def training_of(method: str = "ringlight-ring") -> Training:
    return small(method, 8).build(tiny_scene(views=2, size=16), rasterizer_for("auto"), 3)


def few_rows() -> Model:
    model = training_of().model
    rows = {n: t[:ROWS] if n.startswith(model.row_prefixes) else t for n, t in model.state_dict().items()}
    model.load_tensors(rows)
    return model


def model_and_prediction(regularizer: Regularizer) -> tuple[Model, Rendering]:
    """In float64; the buffers are those that it looks at, of any values."""
    drawn = torch.Generator().manual_seed(2)
    model = (volume_of_trains() if isinstance(regularizer, AppearanceVariation) else few_rows()).double()
    widths = {"normal": 3}
    buffers = {
        name: torch.rand(7, 9, widths.get(name, 1), generator=drawn, dtype=torch.float64)
        for name in regularizer.buffers
    }
    if "normal" in buffers:  # a surface, of which depths make normals: covered, a rough plane
        buffers["alpha"] = 0.92 + 0.07 * buffers["alpha"]
        buffers["depth"] = 2 + 0.1 * buffers["depth"]
    color = torch.rand(7, 9, 3, generator=drawn, dtype=torch.float64)
    camera = Camera(torch.eye(4), (10.0, 11.0), (4.5, 3.5), 9, 7)
    return model, Rendering(color, torch.ones_like(color[..., :1]), buffers, camera=camera)


def term_of(regularizer: Regularizer, model: Model, prediction: Rendering) -> Term:
    return regularizer.term(1, model, prediction)


@pytest.mark.parametrize("name", REGULARIZERS)
def test_gradients_agree_with_finite_differences(name: str):
    """Of all that it could look at: what it gives no gradient for does not change it."""
    regularizer = REGULARIZERS[name]()
    model, prediction = model_and_prediction(regularizer)
    term = term_of(regularizer, model, prediction)
    assert term.grad_buffers.keys() <= set(regularizer.buffers)
    found: dict[str, Tensor] = {**term.grad_buffers, **term.grad_parameters}
    assert any(gradient.any() for gradient in found.values())
    leaves = dict(prediction.buffers) | dict(model.named_parameters())
    assert found.keys() <= leaves.keys()
    gradients = {n: found.get(n, torch.zeros_like(leaf)) for n, leaf in leaves.items()}
    differs = slopes_differ(lambda: term_of(regularizer, model, prediction).value, leaves, gradients)
    assert max(differs.values()) < TOLERANCE, differs


@pytest.mark.parametrize("name", REGULARIZERS)
def test_it_is_a_regularizer_and_leaves_no_graph(name: str):
    regularizer = REGULARIZERS[name]()
    assert isinstance(regularizer, Regularizer)
    model, prediction = model_and_prediction(regularizer)
    for ambient in (torch.no_grad, torch.enable_grad):
        with ambient():
            term = term_of(regularizer, model, prediction)
        assert not term.value.requires_grad
        assert not any(t.requires_grad for t in (*term.grad_buffers.values(), *term.grad_parameters.values()))


@pytest.mark.parametrize("name", REGULARIZERS)
def test_a_buffer_that_nobody_blends_is_refused_before_a_step(name: str):
    regularizer = REGULARIZERS[name]()
    regularizer.buffers = (*regularizer.buffers, "haze")
    sentence = rf"^the {name} regularizer looks at '\w+', which this model does not blend; it blends .*alpha"
    with pytest.raises(RecipeError, match=sentence):
        dataclasses.replace(training_of(), regularizers={name: regularizer})


def test_every_regularizer_of_the_product_is_asked():
    found = pkgutil.iter_modules(regularizers.__path__, f"{regularizers.__name__}.")
    modules = [importlib.import_module(module.name) for module in found]
    own = {c for m in modules for _, c in inspect.getmembers(m, inspect.isclass) if c.__module__ == m.__name__}
    written = {c for c in own if hasattr(c, "term") and c is not Regularizer}
    assert written == {type(made()) for made in REGULARIZERS.values()}
