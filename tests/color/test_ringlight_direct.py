"""Training lights only the rows that a dense view shows, and nothing but time tells."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.color.ringlight import RingLight
from ringlight.color.ringlight_direct import DirectRingLight
from ringlight.errors import BackendError
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.table import METHODS
from ringlight.models.direct import DirectModel
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.horizon import Horizon

CAMERA = workload_camera(96, turn_y=0.3)
WHITE = torch.ones(3)


@pytest.fixture(autouse=True)
def _all_cores_afterwards():
    yield
    _kernels.set_threads(0)


def ball(opacity: float, **light: object) -> tuple[SplatModel, DirectModel, DirectRingLight]:
    """Twenty Gaussians for every pixel: nearly opaque ones hide most of them."""
    recipe = METHODS["ringlight"]
    assert isinstance(recipe, RingLightRecipe)
    recipe = dataclasses.replace(recipe, light=dataclasses.replace(recipe.light, **light), shading="forward")
    model = subject_of_workload("ringlight", recipe, Size.parse("20k@96"), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
    direct = model.direct()
    assert direct is not None
    assert isinstance(direct.color, DirectRingLight)
    return model, direct, direct.color


def step(model: SplatModel, direct: DirectModel, many_hidden: bool) -> dict[str, Tensor]:
    """Picture, alpha and all gradients of one view."""
    assert isinstance(model.color, RingLight)
    model.color.workspace.many_hidden = many_hidden
    rendering = direct.render(CAMERA, WHITE)
    upstream = torch.randn(rendering.color.shape, generator=torch.Generator().manual_seed(4))
    gradients = direct.differentiate(upstream)
    found = {"color": rendering.color, "alpha": rendering.alpha} | {
        name: gradient if isinstance(gradient, Tensor) else gradient.dense() for name, gradient in gradients.items()
    }
    return {name: tensor.clone() for name, tensor in found.items()}


@pytest.mark.parametrize("opacity", [0.05, 0.9])
@pytest.mark.parametrize("light", [{}, {"mask": True}, {"latents": 0}, {"field": "cp"}])
def test_late_colors_change_no_bit_of_a_step(opacity: float, light: dict[str, object]):
    model, direct, color = ball(opacity, **light)
    early = step(model, direct, many_hidden=False)
    assert color.late is None
    for threads in (1, 3):
        _kernels.set_threads(threads)
        late = step(model, direct, many_hidden=True)
        assert color.late is not None
        assert early.keys() == late.keys()
        assert all(torch.equal(early[name], late[name]) for name in early)
    assert early["base"].abs().max() > 0


def test_colors_are_late_after_a_view_that_hid_most_rows():
    for opacity, hides in ((0.9, True), (0.02, False)):
        model, direct, _ = ball(opacity)
        assert isinstance(model.color, RingLight)
        step(model, direct, many_hidden=False)
        assert model.color.workspace.many_hidden is hides


def test_a_view_with_a_horizon_wants_all_colors_first():
    model, direct, color = ball(0.9)
    assert isinstance(model.color, RingLight)
    model.color.workspace.many_hidden = True
    seen = direct.render(CAMERA, WHITE, Horizon()).color.clone()
    assert color.late is None
    assert torch.equal(seen, direct.render(CAMERA, WHITE).color)
    assert color.late is not None


def test_what_is_not_finite_is_named_as_ever():
    model, direct, _ = ball(0.02)
    assert isinstance(model.color, RingLight)
    with torch.no_grad():
        model.columns["latents"][7] = torch.nan
    for many_hidden in (False, True):
        model.color.workspace.many_hidden = many_hidden
        with pytest.raises(BackendError, match="channels"):
            direct.render(CAMERA, WHITE)
