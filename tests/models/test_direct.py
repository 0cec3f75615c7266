"""A mirror's step without autograd, shaded while it is blended: the bits are those of autograd."""

import pytest
import torch
from mirrors import WHITE, mirror, view
from ringlight.models.direct import DirectModel
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.errors import BackendError
from ringlight.models.splats import SplatModel

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

SIZES = [(96, 96), (8, 8), (33, 70), (97, 5), (5, 97)]
"""Some cut tiles and blocks; some are narrower than what the shader's kernel takes at a time."""


def direct(model: SplatModel) -> DirectModel:
    found = model.train().direct()
    assert found is not None
    assert found.shader is not None
    return found


def upstream(width: int, height: int) -> Tensor:
    drawn = torch.randn(3, height, width, generator=torch.Generator().manual_seed(1))
    return drawn.permute(1, 2, 0)


def step(found: DirectModel, camera: Camera) -> tuple[Tensor, dict[str, Tensor]]:
    """Picture and gradients, which the next step leaves alone."""
    color = found.render(camera, WHITE).color
    gradients = found.differentiate(upstream(camera.width, camera.height))
    return color, {name: torch.as_tensor(gradient).clone() for name, gradient in gradients.items()}


def same(one: tuple[Tensor, dict[str, Tensor]], other: tuple[Tensor, dict[str, Tensor]]) -> None:
    assert torch.equal(one[0], other[0])
    assert one[1].keys() == other[1].keys()
    for name, gradient in one[1].items():
        assert torch.equal(gradient, other[1][name]), name


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shader", [{}, {"latents": 0, "hidden": 21}, {"hidden_layers": 1, "depth_gradient": True}])
def test_picture_and_gradients_have_the_bits_of_autograd(size: tuple[int, int], shader: dict[str, object]):
    model, camera = mirror("3000@96", **shader), view(*size)
    expected = model.render(camera, WHITE)
    expected.color.backward(upstream(*size))
    found = direct(model)
    drawn = found.render(camera, WHITE)
    assert torch.equal(drawn.color, expected.color)
    assert (expected.color - expected.buffers["rgb"]).abs().max() > 0
    for name, buffer in expected.buffers.items():
        assert torch.equal(drawn.buffers[name], buffer), name
    gradients = found.differentiate(upstream(*size))
    parameters = {name.removeprefix("columns."): p.grad for name, p in model.named_parameters() if p.grad is not None}
    assert parameters.keys() == gradients.keys()
    for name, gradient in parameters.items():
        assert torch.equal(torch.as_tensor(gradients[name]), gradient), name


def test_shading_later_gives_the_same_bits():
    found, camera = direct(mirror("3000@96")), view()
    at_once = found.render(camera, WHITE)
    blended = found.blend(found.color.draw(found._model.gaussians, camera), camera, WHITE)
    assert torch.equal(found.shade(blended, camera, WHITE).color, at_once.color)


def test_no_block_ends_early_where_gradients_are_wanted():
    """A picture that nobody differentiates may end them; the step's must not."""
    model = mirror("20k@96")
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(3.0)
    assert torch.equal(direct(model).render(view(), WHITE).alpha, model.render(view(), WHITE).alpha.detach())
    assert not torch.equal(model.eval().picture(view(), WHITE).alpha, model.render(view(), WHITE).alpha)


def test_the_same_bits_for_any_number_of_threads():
    found, results = direct(mirror("3000@96")), []
    for threads in (1, 3):
        _kernels.set_threads(threads)
        results.append(step(found, view()))
    same(*results)


@pytest.mark.parametrize("where", ["beside it", "no Gaussians"])
def test_where_there_is_nothing_the_background_is_seen(where: str):
    model, camera = mirror("600@96"), view(70, 33)
    if where == "beside it":
        with torch.no_grad():
            model.columns["means"] += 1000 * camera.position
    else:
        model.load_columns({name: column[:0] for name, column in model.columns.items()})
    color, gradients = step(direct(model), camera)
    assert torch.equal(color, WHITE.expand_as(color))
    assert gradients
    assert not any(gradient.count_nonzero() for gradient in gradients.values())


def test_what_was_blended_goes_with_a_shader():
    """And both with planes of the right size: the compiled rasterizer writes where it is told."""
    found, camera = direct(mirror("50@96")), view(40, 30)
    found.render(camera, WHITE)
    raster = found.rasterize
    tiles = found.shader.tiles(camera, WHITE)
    for shader, planes in (
        (None, torch.empty(11, 30, 40)),
        (tiles, torch.empty(11, 30, 39)),
        (tiles, torch.empty(10, 30, 40)),
    ):
        with pytest.raises(ValueError, match="what was blended goes with a shader"):
            raster._job.draw(raster._workspace, raster._table, shader=shader, blended=planes)


def test_before_the_shader_is_lit_the_base_color_is_shown():
    model = mirror("600@96")
    model.shader.lit.fill_(False)
    model.color.lit.fill_(False)
    found = direct(model)
    drawn = found.render(view(), WHITE)
    assert torch.equal(drawn.color, drawn.buffers["rgb"])
    assert not any(name.startswith("shader.") for name in found.differentiate(upstream(96, 96)))


def test_what_is_not_finite_is_refused_by_name():
    model = mirror("600@96")
    with torch.no_grad():
        model.columns["means"][7, 1] = torch.nan
    with pytest.raises(BackendError, match=r"means.*7"):
        direct(model).render(view(), WHITE)
