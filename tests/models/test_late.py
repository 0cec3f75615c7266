"""Pictures without gradients light only the rows that they show, and are the pictures that training sees."""

import dataclasses

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.color.ringlight import RingLight
from ringlight.core.gaussians import GEOMETRY
from ringlight.errors import BackendError
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.convention import EARLY_STOP
from ringlight.rasterize.cpu_job import Job

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

ROUNDING = 1e-6
WHITE = torch.ones(3)


def lit_model(size: str, opacity: float, **light: object) -> SplatModel:
    """The workload's ball with residuals as large as those of a trained field, which the first weights do not make."""
    recipe = METHODS["ringlight"]
    assert isinstance(recipe, RingLightRecipe)
    recipe = dataclasses.replace(recipe, light=dataclasses.replace(recipe.light, **light), shading="forward")
    model = subject_of_workload("ringlight", recipe, Size.parse(size), rasterizer_for("cpu")).training.model
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
        model.get_parameter("color.shading.render.4.weight").mul_(8)
    return model.eval()


def pictures(model: SplatModel, turn: float = 0.3) -> tuple[Tensor, Tensor]:
    """Without gradients, where rows are lit late; and as training sees the model."""
    camera = workload_camera(96, turn_y=turn)
    with torch.no_grad():
        late = model.render(camera, WHITE).color
    return late, model.render(camera, WHITE).color.detach()


@pytest.mark.parametrize("light", [{}, {"mask": False}, {"latents": 0}, {"field": "cp"}, {"light_modulation": False}])
def test_what_is_not_hidden_has_the_same_bits(light: dict[str, object]):
    late, usual = pictures(lit_model("300@96", 0.2, **light))
    assert usual.std() > 0.02
    assert torch.equal(late, usual)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_behind_what_is_nearly_opaque_more_of_the_same_will_do(turn: float):
    late, usual = pictures(lit_model("20k@96", 0.7), turn)
    error = (late - usual).abs()
    assert 0 < error.max() <= EARLY_STOP + ROUNDING
    assert error.square().mean().sqrt() < EARLY_STOP / 16


def test_what_fills_up_a_block_has_the_colors_in_front():
    """Were it the background, or nothing, a ball of one colour would show it."""
    model, camera = lit_model("20k@96", 0.7), workload_camera(96)
    with torch.no_grad():
        model.columns["base"].fill_(torch.tensor(0.25).logit().item())
        for part in ("weight", "bias"):
            model.get_parameter(f"color.shading.render.4.{part}").zero_()
        drawn = model.render(camera, torch.zeros(3))
    opaque = drawn.alpha == 1
    assert opaque.any()
    assert (drawn.color[opaque.expand(-1, -1, 3)] - 0.25).abs().max() < ROUNDING


def test_what_is_checked_does_not_show_unless_it_is_not_finite():
    model, camera = lit_model("20k@96", 0.7), workload_camera(96)
    gaussians = model.gaussians
    late = model.color.late(gaussians, camera)
    ones = torch.ones_like(gaussians.means)
    with torch.no_grad():
        usual, shown = (
            model.rasterize.draw_late(gaussians, checked, late.kernel, camera, WHITE, model.options)
            for checked in (late.checked, ones)
        )
    assert torch.equal(usual.image, shown.image)
    assert torch.equal(usual.alpha, shown.alpha)
    lost = ones.index_fill(0, torch.tensor([len(ones) - 1]), torch.nan)
    assert model.rasterize.draw_late(gaussians, lost, late.kernel, camera, WHITE, model.options) is None


def test_colors_that_nobody_keeps_make_exact_pictures_too():
    model, camera = lit_model("20k@96", 0.7), workload_camera(96)
    gaussians = model.gaussians
    assert isinstance(model.color, RingLight)
    late = model.color.late(gaussians, camera)
    assert late is not None
    columns = [getattr(gaussians, name).detach() for name in GEOMETRY]
    job = Job(camera, WHITE, model.options, len(gaussians))
    factor = late.opacity_factor
    image, _ = job.draw(_kernels.Workspace(), job.table([*columns, factor, late.checked]), late.kernel)
    assert torch.equal(image.permute(1, 2, 0), model.render(camera, WHITE).color.detach())


def test_any_number_of_threads_gives_the_same_bits():
    model, camera = lit_model("20k@96", 0.4), workload_camera(96)
    found = []
    for threads in (1, 2, 4, 4, 4):
        _kernels.set_threads(threads)
        with torch.no_grad():
            found.append(model.render(camera, WHITE).color)
    assert all(torch.equal(picture, found[0]) for picture in found)


def test_what_is_not_finite_is_named_as_ever():
    model = lit_model("300@96", 0.5)
    with torch.no_grad():
        model.columns["latents"][7] = torch.nan
    with torch.no_grad(), pytest.raises(BackendError, match="channels"):
        model.render(workload_camera(96), WHITE)


def test_a_camera_that_is_not_finite_is_named_as_ever():
    model, camera = lit_model("300@96", 0.5), workload_camera(96)
    lost = dataclasses.replace(camera, focal=(float("nan"), 1.0))
    with torch.no_grad(), pytest.raises(BackendError, match="lens"):
        model.render(lost, WHITE)


def test_late_colors_of_another_table_are_refused():
    """Of fewer rows the kernels would read what is not there."""
    model, camera = lit_model("300@96", 0.5), workload_camera(96)
    assert isinstance(model.color, RingLight)
    gaussians = model.gaussians
    fewer = gaussians.rows(torch.arange(200))
    late = model.color.late(fewer, camera)
    assert late is not None
    assert model.rasterize.draw_late(fewer, late.checked, late.kernel, camera, WHITE) is not None
    with torch.no_grad():
        assert model.rasterize.draw_late(gaussians, gaussians.means, late.kernel, camera, WHITE) is None


def test_where_it_does_not_apply_the_usual_way_is_taken():
    camera = workload_camera(96)
    exact = lit_model("300@96", 0.5, evaluation="exact")
    assert isinstance(exact.color, RingLight)
    assert exact.color.late(exact.gaussians, camera) is None
    model = lit_model("300@96", 0.5)
    model.get_buffer("color.lit").fill_(False)
    assert isinstance(model.color, RingLight)
    assert model.color.late(model.gaussians, camera) is None
