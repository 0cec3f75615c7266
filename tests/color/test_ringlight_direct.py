"""Training lights only the rows that a dense view shows, and nothing but time tells."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.color.ring_kernel import late_light, ring_parameters, shading_layers
from ringlight.color.ringlight import RingLight
from ringlight.color.ringlight_direct import DirectRingLight
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.errors import BackendError
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.table import METHODS
from ringlight.models.direct import DirectModel
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

CAMERA = workload_camera(96, turn_y=0.3)
WHITE = torch.ones(3)


def ball(opacity: float, **light: object) -> tuple[SplatModel, DirectModel, DirectRingLight]:
    """Twenty Gaussians for every pixel: nearly opaque ones hide most of them."""
    recipe = METHODS["ringlight"]
    assert isinstance(recipe, RingLightRecipe)
    recipe = dataclasses.replace(recipe, light=dataclasses.replace(recipe.light, **light), shading="forward")
    model = subject_of_workload("ringlight", recipe, Size.parse("20k@96"), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
        model.get_parameter("color.shading.render.4.weight").mul_(8)  # residuals that count, and some that are clamped
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
    assert all(gradient.abs().max() > 0 for name, gradient in early.items() if name.startswith(("base", "color.")))


def test_colors_are_late_after_a_view_that_hid_most_rows():
    for opacity, hides in ((0.9, True), (0.02, False)):
        model, direct, _ = ball(opacity)
        assert isinstance(model.color, RingLight)
        step(model, direct, many_hidden=False)
        assert model.color.workspace.many_hidden is hides


@pytest.mark.parametrize("broken", ["columns.latents", "color.shading.render.4.bias"])
def test_what_is_not_finite_is_named_as_ever(broken: str):
    """Of the ball's last row, which is hidden as a rule, or of what all rows share."""
    model, direct, _ = ball(0.9)
    assert isinstance(model.color, RingLight)
    with torch.no_grad():
        model.get_parameter(broken)[-1] = torch.nan
    for many_hidden in (False, True):
        model.color.workspace.many_hidden = many_hidden
        with pytest.raises(BackendError, match="channels"):
            direct.render(CAMERA, WHITE)


def test_a_base_color_of_pure_white_is_drawn_whichever_way():
    model, direct, _ = ball(0.9)
    with torch.no_grad():
        model.columns["base"][:40] = torch.inf
    early, late = (step(model, direct, many_hidden)["color"] for many_hidden in (False, True))
    assert torch.equal(early, late)


def test_a_row_that_fills_up_a_group_may_be_anything_unless_it_is_asked_for():
    """One tile. The first chunk of 128 rows closes the blocks around (6, 6); a hundred rows of the second ask, at
    (26, 26), and what fills up their last group are rows of the third, all of them behind closed blocks."""
    model, _, _ = ball(0.9)
    assert isinstance(model.color, RingLight)
    camera = Camera(torch.eye(4), (32.0, 32.0), (16.0, 16.0), 32, 32)
    number = torch.arange(300)
    closing, asking = number < 128, (number >= 128) & (number < 228)
    depth = 4 + number * 1e-3
    pixel = torch.where(asking, 26.0, 6.0)
    columns = {name: column.detach() for name, column in model.gaussians.rows(number).columns().items()}
    columns["means"] = torch.stack([(pixel - 16) / 32 * depth, (pixel - 16) / 32 * depth, depth], 1)
    columns["log_scales"] = torch.where(closing, 3 / 8, 0.01).log()[:, None].expand(-1, 3).contiguous()
    columns["opacity_logits"] = torch.where(closing, 0.99, 0.02).logit()
    columns["latents"] = columns["latents"].index_fill(0, torch.tensor([260]), torch.nan)
    gaussians = Gaussians.from_columns(columns)
    base, latents = gaussians.appearance["base"], gaussians.appearance["latents"]
    parameters = ring_parameters(model.color.tables(), model.color.shading, shading_layers(model.color.shading))
    for colors in (None, torch.zeros_like(base)):
        late = late_light(gaussians.means, camera.native, model.color.box, base, latents, parameters, colors)
        assert model.rasterize.draw_late(gaussians, base, late, camera, WHITE) is not None
    assert colors[260].isnan().all()  # lit, and not shown


def test_no_backward_pass_follows_a_late_color_that_is_not_finite():
    model, direct, color = ball(0.9)
    step(model, direct, many_hidden=True)  # leaves a picture that could be taken for this one's
    with torch.no_grad():
        model.get_parameter("color.shading.render.4.bias")[-1] = torch.nan
    base = color.draw(model.gaussians, CAMERA, may_be_late=True)
    assert color.late is not None
    with pytest.raises(ValueError, match="colours are not finite"):
        direct.rasterize.draw(model.gaussians, base, CAMERA, WHITE, model.options, None, color.late)
    with pytest.raises(ValueError, match="backward needs"):
        direct.rasterize.differentiate(torch.ones(96, 96, 3))
