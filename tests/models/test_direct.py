"""A mirror's step without autograd, shaded while it is blended: the bits are those of autograd."""

import dataclasses

import pytest
import torch
from mirrors import WHITE, mirror, view
from torch import Tensor

from ringlight import _kernels
from ringlight.errors import BackendError
from ringlight.models.direct import DirectModel
from ringlight.models.splats import SplatModel
from ringlight.rasterize.horizon import Horizon

SIZES = [(96, 96), (8, 8), (33, 70), (97, 5), (5, 97)]
"""Some cut tiles and blocks; some are narrower than what the shader's kernel takes at a time."""


@pytest.fixture(autouse=True)
def _all_cores_afterwards():
    yield
    _kernels.set_threads(0)


def direct(model: SplatModel) -> DirectModel:
    found = model.train().direct()
    assert found is not None
    assert found.shader is not None
    return found


def upstream(width: int, height: int) -> Tensor:
    drawn = torch.randn(3, height, width, generator=torch.Generator().manual_seed(1))
    return drawn.permute(1, 2, 0)


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
    shared = {name: p.grad for name, p in model.named_parameters() if name.startswith("shader.")}
    assert shared
    for name, gradient in shared.items():
        assert torch.equal(gradients[name], gradient), name
    assert torch.equal(gradients["means"], model.columns["means"].grad)


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


def test_a_horizon_changes_no_bit():
    model, horizon = mirror("20k@96"), Horizon()
    camera = dataclasses.replace(view(), focal=tuple(4 * length for length in view().focal))  # no background
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(3.0)
        model.columns["log_scales"] += 0.7  # until whole tiles are opaque
    found = direct(model)
    expected = found.render(camera, WHITE)
    for _ in range(2):
        drawn = found.render(camera, WHITE, horizon)
        assert torch.equal(drawn.color, expected.color)
    assert horizon.depths.isfinite().any()


def test_the_same_bits_for_any_number_of_threads():
    model, results = mirror("3000@96"), []
    for threads in (1, 3):
        _kernels.set_threads(threads)
        found = direct(model)
        color = found.render(view(), WHITE).color
        gradients = found.differentiate(upstream(96, 96))
        results.append([color, *(torch.as_tensor(gradients[name]) for name in ("means", "shader.mlp.0.weight"))])
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))


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
