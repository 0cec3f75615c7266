"""Fast pictures light only the rows that they show, and are the pictures that training sees, but for 1/64 at most."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.core.camera import Camera
from ringlight.core.rendering import Emission, LazyColors, Raster, Rendering
from ringlight.core.want import Want
from ringlight.errors import BackendError
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.convention import EARLY_STOP
from small_recipes import with_settings

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

ROUNDING = 1e-6
WHITE = torch.ones(3)


def lit_model(size: str, opacity: float, **light: object) -> SplatModel:
    """The workload's ball with residuals as large as those of a trained field, which the first weights do not make."""
    recipe = with_settings(METHODS["ringlight-ring"], {"light": light})
    model = subject_of_workload("ringlight-ring", recipe, Size.parse(size), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
        model.get_parameter("color.shading.render.4.weight").mul_(8)
    return model.eval()


def pictures(model: SplatModel, turn: float = 0.3) -> tuple[Tensor, Tensor]:
    """Fast, where rows are lit lazily; and as training sees the model."""
    camera = workload_camera(96, turn_y=turn)
    assert lazy_colors(model, camera) is not None
    return picture(model, camera).color, model.render(camera, WHITE, Want.GRADIENTS).color


def picture(model: SplatModel, camera: Camera, behind: Tensor = WHITE) -> Rendering:
    return model.render(camera, behind, Want.PICTURE)


def lazy_colors(model: SplatModel, camera: Camera) -> LazyColors | None:
    return model.color.emit(model.gaussians, camera, ("rgb",), Want.PICTURE).lazy


@pytest.mark.parametrize("light", [{}, {"mask": False}, {"latents": 0}, {"field": "cp"}, {"light_modulation": False}])
def test_what_is_not_hidden_has_the_same_bits(light: dict[str, object]):
    lazy, usual = pictures(lit_model("300@96", 0.2, **light))
    assert usual.std() > 0.02
    assert torch.equal(lazy, usual)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_behind_what_is_nearly_opaque_more_of_the_same_will_do(turn: float):
    lazy, usual = pictures(lit_model("20k@96", 0.7), turn)
    error = (lazy - usual).abs()
    assert 0 < error.max() <= EARLY_STOP + ROUNDING
    assert error.square().mean().sqrt() < EARLY_STOP / 16


def test_what_fills_up_a_block_has_the_colors_in_front():
    """Were it the background, or nothing, a ball of one colour would show it."""
    model, camera = lit_model("20k@96", 0.7), workload_camera(96)
    with torch.no_grad():
        model.columns["base"].fill_(torch.tensor(0.25).logit().item())
        for part in ("weight", "bias"):
            model.get_parameter(f"color.shading.render.4.{part}").zero_()
    drawn = picture(model, camera, torch.zeros(3))
    opaque = drawn.alpha == 1
    assert opaque.any()
    assert (drawn.color[opaque.expand(-1, -1, 3)] - 0.25).abs().max() < ROUNDING


def drawn_lazily(model: SplatModel, checked: Tensor, lazy: LazyColors, camera: Camera) -> Raster:
    """Nobody can fall back on all rows."""

    def never() -> Tensor:
        raise AssertionError("all rows were asked for")

    emission = Emission({"rgb": 3}, dataclasses.replace(lazy, checked=checked, all_rows=never))
    return model.rasterize.draw(model.gaussians, emission, camera, WHITE, model.options, Want.PICTURE)


def test_what_is_checked_does_not_show_unless_it_is_not_finite():
    model, camera = lit_model("20k@96", 0.7), workload_camera(96)
    lazy, ones = lazy_colors(model, camera), torch.ones_like(model.gaussians.means)
    assert lazy is not None
    usual, shown = (drawn_lazily(model, checked, lazy, camera) for checked in (lazy.checked, ones))
    assert torch.equal(usual.image, shown.image)
    assert torch.equal(usual.alpha, shown.alpha)
    lost = ones.index_fill(0, torch.tensor([len(ones) - 1]), torch.nan)
    with pytest.raises(AssertionError, match="all rows were asked for"):
        drawn_lazily(model, lost, lazy, camera)


def test_any_number_of_threads_gives_the_same_bits():
    model, camera = lit_model("20k@96", 0.4), workload_camera(96)
    found = []
    for threads in (1, 2, 4, 4, 4):
        _kernels.set_threads(threads)
        found.append(picture(model, camera).color)
    assert all(torch.equal(other, found[0]) for other in found)


def test_what_is_not_finite_is_named_as_ever():
    model = lit_model("300@96", 0.5)
    with torch.no_grad():
        model.columns["latents"][7] = torch.nan
    with pytest.raises(BackendError, match="channels"):
        picture(model, workload_camera(96))


def test_a_camera_that_is_not_finite_is_named_as_ever():
    model, camera = lit_model("300@96", 0.5), workload_camera(96)
    lost = dataclasses.replace(camera, focal=(float("nan"), 1.0))
    with pytest.raises(BackendError, match="lens"):
        picture(model, lost)


def test_lazy_colors_of_another_table_are_refused():
    """Of fewer rows the kernels would read what is not there."""
    model, camera = lit_model("300@96", 0.5), workload_camera(96)
    fewer = model.gaussians.rows(torch.arange(200))
    lazy = model.color.emit(fewer, camera, ("rgb",), Want.PICTURE).lazy
    assert lazy is not None
    with pytest.raises(AssertionError, match="all rows were asked for"):
        drawn_lazily(model, model.gaussians.means, lazy, camera)


def test_where_it_does_not_apply_the_usual_way_is_taken():
    camera = workload_camera(96)
    exact = lit_model("300@96", 0.5, evaluation="exact")
    assert lazy_colors(exact, camera) is None
    unlit = lit_model("300@96", 0.5)
    unlit.get_buffer("color.lit").fill_(False)
    assert lazy_colors(unlit, camera) is None
    for model in (exact, unlit):
        assert torch.equal(picture(model, camera).color, model.render(camera, WHITE, Want.GRADIENTS).color)
    lit = lit_model("300@96", 0.5)
    assert lit.color.emit(lit.gaussians, camera, ("rgb",), Want.EXACT).lazy is None
