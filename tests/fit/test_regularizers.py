"""Terms of the loss that look at parameters or buffers: their gradients arrive, and what nobody blends is refused."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight.core.gradients import dense
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fit.regularizers.by_torch import TorchRegularizer
from ringlight.fit.regularizers.contract import EveryStep, Regularizer, Term
from ringlight.fit.regularizers.mean_mask import MeanMask
from ringlight.fit.train import Training, gradients_of, train
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.reference import ReferenceRasterizer
from tiny_scene import tiny_scene

STEP = 1e-6
"""Of a central difference in float64."""


def training_of(method: str, regularizers: dict[str, Regularizer]) -> Training:
    """Two views of tiny balls; the light field and the shader are on from the first step."""
    recipe = dataclasses.replace(METHODS[method], steps=30)
    if method == "ringlight":
        recipe = dataclasses.replace(recipe, shading="basis")
    if method == "ringlight-mirror":
        shader = dataclasses.replace(recipe.shader, hidden=16, levels=(9, 5), gradient_share=1.0)
        recipe = dataclasses.replace(recipe, shader=shader)
    training = recipe.build(tiny_scene(views=2, size=16), rasterizer_for("cpu"), seed=0)
    for name, buffer in training.model.named_buffers():
        if name.endswith(".lit"):
            buffer.fill_(True)
    return dataclasses.replace(training, regularizers=regularizers)


def found_gradients(training: Training) -> dict[str, Tensor]:
    """Of the regularizers alone, by parameter name."""
    batch = training.batches.at(1)
    prediction = training.model.predict(batch, Want.GRADIENTS, training.buffers_at(1))
    compared = training.loss.compare(prediction, batch, training.model)
    compared = dataclasses.replace(compared, grad_color=torch.zeros_like(compared.grad_color))
    terms = {name: r.term(1, training.model, prediction) for name, r in training.regularizers.items()}
    gradients = gradients_of(training, prediction, compared, terms)
    return {name: dense(gradient) for name, gradient in gradients.items()}


def smooth(tensors: dict[str, Tensor]) -> Tensor:
    """A term of one tensor that has no kinks, with a weight."""
    (values,) = tensors.values()
    return 0.3 * (values * values).mean() + 0.1 * values.sin().mean()


@pytest.mark.parametrize(
    ("method", "buffer"),
    [
        ("ringlight-mirror", "depth"),
        ("ringlight-mirror", "normal"),
        ("ringlight-mirror", "alpha"),
        ("ringlight", "alpha"),
        ("3dgs", "alpha"),
        ("3dgs", "rgb"),
    ],
)
def test_a_buffers_regularizer_has_the_gradient_of_finite_differences(method: str, buffer: str):
    training = training_of(method, {"smooth": TorchRegularizer(smooth, buffers=(buffer,))})
    drawn = torch.Generator().manual_seed(2)
    if "normals" in training.model.columns:  # those of tiny balls include some without length, whose slope has no end
        training.model.columns["normals"].data = torch.randn(len(training.model), 3, generator=drawn)
    found = found_gradients(training)
    assert found.pop("columns.mask_logits", torch.ones(1)).any()  # a step, whose gradient is a sigmoid's
    assert found["columns.opacity_logits"].any()
    model, batch = training.model, training.batches.at(1)
    double = SplatModel(model.gaussians, model.color, model.shader, ReferenceRasterizer(), model.options).double()
    background = batch.background.double()

    def value() -> float:
        return float(smooth({buffer: double.render(batch.camera, background, Want.EXACT, (buffer,)).buffers[buffer]}))

    for name, gradient in found.items():
        if not name.startswith("columns."):
            assert not gradient.any(), f"{name}: of no shader's business"
            continue
        column = double.get_parameter(name)
        kept, direction = column.detach().clone(), torch.randn(column.shape, generator=drawn, dtype=torch.float64)
        ends = []
        for sign in (1, -1):
            column.data = kept + sign * STEP * direction
            ends.append(value())
        column.data = kept
        expected = (ends[0] - ends[1]) / (2 * STEP)
        # Kernels are float32, and no pixel is kept away from the cut-offs: 2e-3 of what the direction could give.
        scale = gradient.double().norm().item() + 1e-12
        assert abs((gradient.double() * direction).sum().item() - expected) < 2e-3 * scale + 1e-9, name


def test_buffers_that_several_look_at_are_blended_once_and_their_gradients_add_up():
    depth = TorchRegularizer(smooth, buffers=("depth",))
    (one, two) = ({"a": depth}, {"a": depth, "b": depth})
    assert training_of("ringlight-mirror", two).buffers_at(1) == ("depth",)
    single, double = (found_gradients(training_of("ringlight-mirror", chosen)) for chosen in (one, two))
    assert single["columns.means"].any()
    assert single.keys() == double.keys()
    for name, gradient in single.items():
        torch.testing.assert_close(double[name], 2 * gradient, rtol=1e-4, atol=1e-9)


def test_a_regularizer_on_parameters_adds_its_gradient_and_one_without_gradient_only_counts():
    def scales(tensors: dict[str, Tensor]) -> Tensor:
        return tensors["columns.log_scales"].exp().mean()

    def constant(tensors: dict[str, Tensor]) -> Tensor:
        return scales(tensors).detach()

    def after_one_step(regularizers: dict[str, Regularizer]):
        training = training_of("3dgs", regularizers)
        return next(train(training)), training.model.columns["log_scales"].detach()

    plain, without = after_one_step({})
    for function in (scales, constant):
        progress, regularized = after_one_step({"scales": TorchRegularizer(function, ("columns.log_scales",))})
        assert set(progress.losses) == {"photometric", "scales"}
        assert progress.loss > plain.loss
        assert torch.equal(regularized, without) is (function is constant)


def test_the_mean_mask_is_its_formula_and_its_gradient():
    training = training_of("ringlight", {})
    model = training.model
    logits = torch.linspace(-3, 3, len(model))
    model.columns["mask_logits"] = torch.nn.Parameter(logits.clone())
    term = MeanMask(0.2).term(1, model, Rendering(torch.zeros(1, 1, 3), torch.zeros(1, 1, 1)))
    leaf = logits.clone().requires_grad_()
    expected = 0.2 * leaf.sigmoid().mean()
    expected.backward()
    torch.testing.assert_close(term.value, expected.detach())
    assert term.grad_parameters.keys() == {"columns.mask_logits"}
    torch.testing.assert_close(term.grad_parameters["columns.mask_logits"], leaf.grad)
    assert not term.grad_buffers


@pytest.mark.parametrize(("method", "known"), [("3dgs", "rgb, alpha"), ("ringlight", "rgb, alpha")])
def test_a_buffer_that_nobody_blends_is_refused_when_the_training_is_made(method: str, known: str):
    sentence = rf"^the smoothness regularizer looks at 'depth', which this model does not blend; it blends {known}$"
    with pytest.raises(RecipeError, match=sentence):
        training_of(method, {"smoothness": TorchRegularizer(smooth, buffers=("depth",))})


def test_a_regularizer_of_ones_own_is_one():
    class Own(EveryStep):
        buffers: tuple[str, ...] = ("alpha",)

        def term(self, step: int, model: object, prediction: Rendering) -> Term:
            alpha = prediction.buffers["alpha"]
            return Term(alpha.mean(), {"alpha": torch.full_like(alpha, 1 / alpha.numel())})

    assert isinstance(Own(), Regularizer)
    assert isinstance(MeanMask(0.1), Regularizer)
    assert isinstance(TorchRegularizer(smooth), Regularizer)
    mine = found_gradients(training_of("3dgs", {"own": Own()}))
    mean = TorchRegularizer(lambda tensors: tensors["alpha"].mean(), buffers=("alpha",))
    theirs = found_gradients(training_of("3dgs", {"own": mean}))
    assert mine["columns.opacity_logits"].any()
    for name, gradient in theirs.items():
        torch.testing.assert_close(mine[name], gradient)


def test_one_that_looks_now_and_then_is_asked_in_those_steps_alone_and_only_there_is_its_buffer_blended():
    class EveryThird:
        buffers: tuple[str, ...] = ("depth",)

        def looks(self, step: int) -> bool:
            return step % 3 == 0

        def term(self, step: int, model: object, prediction: Rendering) -> Term:
            assert "depth" in prediction.buffers
            return Term(torch.tensor(0.5))

    mean = TorchRegularizer(lambda of: of["alpha"].mean(), buffers=("alpha",))
    training = training_of("ringlight-mirror", {"third": EveryThird(), "mean": mean})
    assert [training.buffers_at(step) for step in (2, 3)] == [("alpha",), ("depth", "alpha")]
    for progress, _ in zip(train(training), range(7), strict=False):
        third = {"third"} if progress.step % 3 == 0 else set()
        assert progress.losses.keys() == {"photometric", "mean"} | third
