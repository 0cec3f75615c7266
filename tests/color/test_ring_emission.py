"""Training lights only the rows that a dense view shows, and nothing but time tells."""

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.color.ring_kernel import lazy_light, ring_parameters
from ringlight.color.ringlight import RingLight
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import dense
from ringlight.core.rendering import Emission, LazyColors, Raster
from ringlight.core.want import Want
from ringlight.errors import BackendError
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import with_settings

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

CAMERA = workload_camera(96, turn_y=0.3)
WHITE = torch.ones(3)


def ball(opacity: float, **light: object) -> tuple[SplatModel, RingLight]:
    """Twenty Gaussians for every pixel: nearly opaque ones hide most of them."""
    recipe = with_settings(METHODS["ringlight-ring"], {"light": light})
    model = subject_of_workload("ringlight-ring", recipe, Size.parse("20k@96"), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
        model.get_parameter("color.shading.render.4.weight").mul_(8)  # residuals that count, and some that are clamped
    assert isinstance(model.color, RingLight)
    return model, model.color


def step(model: SplatModel, color: RingLight, lazily: bool) -> dict[str, Tensor]:
    """Picture, alpha and all gradients of one view."""
    color.workspace.many_hidden = lazily
    assert (emitted(model, color).lazy is not None) == lazily
    rendering = model.render(CAMERA, WHITE, Want.GRADIENTS)
    upstream = torch.randn(rendering.color.shape, generator=torch.Generator().manual_seed(4))
    gradients = rendering.backward(upstream, {})
    return {"color": rendering.color, "alpha": rendering.alpha} | {name: dense(g) for name, g in gradients.items()}


def emitted(model: SplatModel, color: RingLight) -> Emission:
    return color.emit(model.gaussians, CAMERA, ("rgb",), Want.GRADIENTS)


@pytest.mark.parametrize("opacity", [0.05, 0.9])
@pytest.mark.parametrize("light", [{}, {"mask": True}, {"latents": 0}, {"field": "cp"}])
def test_lazy_colors_change_no_bit_of_a_step(opacity: float, light: dict[str, object]):
    model, color = ball(opacity, **light)
    early = step(model, color, lazily=False)
    assert {name for name in early if name.startswith("color.")} == {
        f"color.{name}" for name, _ in color.named_parameters()
    }
    for threads in (1, 3):
        _kernels.set_threads(threads)
        lazy = step(model, color, lazily=True)
        assert early.keys() == lazy.keys()
        assert all(torch.equal(early[name], lazy[name]) for name in early)
    learning = ("columns.base", "color.")
    assert all(gradient.abs().max() > 0 for name, gradient in early.items() if name.startswith(learning))


def test_colors_are_lazy_after_a_view_that_hid_most_rows():
    for opacity, hides in ((0.9, True), (0.02, False)):
        model, color = ball(opacity)
        step(model, color, lazily=False)
        assert color.workspace.many_hidden is hides
        assert (emitted(model, color).lazy is not None) is hides


def test_who_ignores_the_hint_gets_the_same_bits():
    model, color = ball(0.9)
    early = step(model, color, lazily=False)
    color.workspace.many_hidden = True
    emission = emitted(model, color)
    assert emission.lazy is not None
    plain = Emission(emission.widths, emission.channels, emission.opacity_factor, emission.backward)
    assert torch.equal(plain.channels, color.emit(model.gaussians, CAMERA, ("rgb",), Want.EXACT).channels)
    raster = model.rasterize.draw(model.gaussians, plain, CAMERA, WHITE, model.options)
    assert torch.equal(raster.image, early["color"])


@pytest.mark.parametrize("broken", ["columns.latents", "color.shading.render.4.bias"])
def test_what_is_not_finite_is_named_as_ever(broken: str):
    """Of the ball's last row, which is hidden as a rule, or of what all rows share."""
    model, color = ball(0.9)
    with torch.no_grad():
        model.get_parameter(broken)[-1] = torch.nan
    for want in (Want.GRADIENTS, Want.EXACT):
        for many_hidden in (False, True):
            color.workspace.many_hidden = many_hidden
            with pytest.raises(BackendError, match="channels"):
                model.render(CAMERA, WHITE, want)


def test_a_base_color_of_pure_white_is_drawn_whichever_way():
    model, color = ball(0.9)
    with torch.no_grad():
        model.columns["base"][:40] = torch.inf
    color.workspace.many_hidden = True
    assert emitted(model, color).lazy is None, "a sum that is not finite lets no one be lazy"
    lazily = model.render(CAMERA, WHITE, Want.GRADIENTS).color
    assert torch.equal(step(model, color, lazily=False)["color"], lazily)


def test_a_row_that_fills_up_a_group_may_be_anything_unless_it_is_asked_for():
    """One tile. The first chunk of 128 rows closes the blocks around (6, 6); a hundred rows of the second ask, at
    (26, 26), and what fills up their last group are rows of the third, all of them behind closed blocks."""
    model, color = ball(0.9)
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
    parameters = ring_parameters(color.tables(Want.EXACT), color.shading, color.layers_of_shading)
    for colors in (None, torch.zeros_like(base)):
        kernel = lazy_light(gaussians.means, camera.native, color.box, base, latents, parameters, colors)
        raster = drawn_lazily(model, gaussians, base, kernel, camera)
        assert raster.image.isfinite().all()
    assert colors[260].isnan().all()  # lit, and not shown


def drawn_lazily(
    model: SplatModel, gaussians: Gaussians, checked: Tensor, kernel: "_kernels.LazyColors", camera: Camera
) -> Raster:
    """A view whose colours exist only where it asks for them: nobody can fall back on all rows."""

    def never() -> Tensor:
        raise AssertionError("all rows were asked for")

    emission = Emission({"rgb": 3}, LazyColors(checked, kernel, never))
    return model.rasterize.draw(gaussians, emission, camera, WHITE, model.options)


def test_no_way_back_follows_a_lazy_color_that_is_not_finite():
    """The rasterizer sees it while it blends, asks for all rows, and says which are broken."""
    model, color = ball(0.9)
    step(model, color, lazily=True)  # leaves a picture that could be taken for this one's
    with torch.no_grad():
        model.get_parameter("color.shading.render.4.bias")[-1] = torch.nan
    color.workspace.many_hidden = True
    emission = emitted(model, color)
    assert emission.lazy is not None
    with pytest.raises(BackendError, match="column channels holds nan"):
        model.rasterize.draw(model.gaussians, emission, CAMERA, WHITE, model.options, Want.GRADIENTS)
    assert len(model.rasterize.spare) == 1, "no record keeps the workspace"
