"""Whatever is wanted, torch's own switch decides nothing; and of every method the exact picture is the step's."""

import dataclasses
from typing import Any

import pytest
import torch

from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.core.gradients import Gradients, dense
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.methods.table import CHOOSERS, METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import SPLATS

CAMERA = workload_camera(64, turn_y=0.3)
WHITE = torch.ones(3)


@pytest.fixture(params=[(method, lit) for method in (*CHOOSERS, *SPLATS) for lit in (True, False)], ids=str)
def model(request: pytest.FixtureRequest) -> SplatModel:
    """Every method on the workload, before and after what it switches on: dense enough that much is hidden."""
    method, lit = request.param
    recipe: Any = METHODS[method]
    if any(field.name == "shading" for field in dataclasses.fields(recipe)):
        recipe = dataclasses.replace(recipe, shading="basis")
    found = subject_of_workload(method, recipe, Size.parse("4k@64"), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        found.columns["opacity_logits"].fill_(2.0)
        if "basis_weights" in found.columns:  # they begin at zero, and what is shared gets no gradient then
            found.columns["basis_weights"].fill_(0.1)
    for name, buffer in found.named_buffers():
        if name.endswith(".lit"):
            buffer.fill_(lit)
    return found


def assert_same(found: Rendering, expected: Rendering) -> None:
    assert torch.equal(found.color, expected.color)
    assert torch.equal(found.alpha, expected.alpha)
    assert found.buffers.keys() == expected.buffers.keys()
    assert all(torch.equal(found.buffers[name], buffer) for name, buffer in expected.buffers.items())
    assert not any(tensor.requires_grad for tensor in (found.color, found.alpha, *found.buffers.values()))


@pytest.mark.parametrize("want", Want)
def test_a_call_gives_the_same_bits_with_and_without_torchs_switch(model: SplatModel, want: Want):
    usual = model.render(CAMERA, WHITE, want)
    for switch in (torch.no_grad, torch.enable_grad, torch.inference_mode):
        with switch():
            assert_same(model.render(CAMERA, WHITE, want), usual)


def test_the_way_back_is_the_same_with_and_without_torchs_switch(model: SplatModel):
    upstream = torch.randn(64, 64, 3, generator=torch.Generator().manual_seed(4))

    def gradients() -> Gradients:
        return model.render(CAMERA, WHITE, Want.GRADIENTS).backward(upstream, {})

    usual = gradients()
    assert usual.keys() <= {name for name, _ in model.named_parameters()}
    assert {name for name in usual if name.startswith("columns.")} >= {"columns.means", "columns.quats"}
    with torch.no_grad():
        silent = gradients()
    assert usual.keys() == silent.keys()
    for name, gradient in usual.items():
        assert torch.equal(dense(silent[name]), dense(gradient)), name
        assert dense(gradient).shape == model.get_parameter(name).shape, name
        assert dense(gradient).any(), name


def test_gradients_and_exact_give_the_same_bits(model: SplatModel):
    assert_same(model.render(CAMERA, WHITE, Want.EXACT), model.render(CAMERA, WHITE, Want.GRADIENTS))


def test_nothing_is_left_on_the_parameters(model: SplatModel):
    rendering = model.render(CAMERA, WHITE, Want.GRADIENTS)
    rendering.backward(torch.ones(64, 64, 3), {})
    assert all(parameter.grad is None for parameter in model.parameters())
