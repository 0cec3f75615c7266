"""What every shader must do, parametrised over all that are plugged in."""

import pytest
import torch
from surfaces import buffers, camera
from torch import Tensor, nn

from contracts.differences import TOLERANCE, slopes_differ
from contracts.plugged import CONSTANT, SHADERS
from ringlight.core.gradients import SHADER, Gradients, dense
from ringlight.core.rendering import Shaded
from ringlight.core.want import Want
from ringlight.shade.contract import Shader

VIEW = camera(9, 7)
GREY = torch.tensor([0.5, 0.4, 0.3])

pytestmark = [pytest.mark.parametrize("name", SHADERS)]


def shader_of(name: str, dtype: torch.dtype = torch.float32) -> nn.Module:
    """With features large enough to count."""
    shader = SHADERS[name]()
    with torch.no_grad():
        for parameter_name, parameter in shader.named_parameters():
            if parameter_name.startswith("maps"):
                parameter.mul_(30)
    return shader.to(dtype)


def image_of(shader: nn.Module, dtype: torch.dtype = torch.float32) -> tuple[Tensor, Tensor]:
    """What the shader needs, side by side in planar memory, and alpha."""
    blended = buffers(VIEW, dict(shader.needs).get("latents", 0), dtype=dtype)
    drawn = torch.Generator().manual_seed(2)
    for channel, width in shader.needs.items():  # those that no shader of the product reads
        if channel not in blended:
            values = torch.rand(VIEW.height, VIEW.width, width, generator=drawn, dtype=torch.float64)
            blended[channel] = values.to(dtype) * blended["alpha"]
    planes = torch.cat([blended[channel].permute(2, 0, 1) for channel in shader.needs])
    return planes.permute(1, 2, 0), blended["alpha"]


def channels_of(shader: nn.Module, image: Tensor) -> dict[str, Tensor]:
    """Views of it, by channel."""
    return dict(zip(shader.needs, image.split(list(shader.needs.values()), -1), strict=True))


def shaded(shader: nn.Module, image: Tensor, alpha: Tensor, want: Want) -> Shaded:
    return shader.shade(image, alpha, VIEW, GREY, want)


def upstream(color: Tensor) -> Tensor:
    drawn = torch.randn(color.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return drawn.to(color)


def test_it_is_a_shader_and_says_whether_it_adds_light(name: str):
    shader = shader_of(name)
    assert isinstance(shader, Shader)
    assert dict(shader.needs)["rgb"] == 3
    image, alpha = image_of(shader)
    color = shaded(shader, image, alpha, Want.EXACT).color
    assert color.shape == (VIEW.height, VIEW.width, 3)
    assert color.isfinite().all()
    assert torch.equal(color, channels_of(shader, image)["rgb"]) is not shader.adds_light


@pytest.mark.parametrize("ambient", [torch.no_grad, torch.enable_grad])
def test_the_call_says_what_is_wanted_and_nothing_else_does(name: str, ambient: type):
    shader = shader_of(name)
    image, alpha = image_of(shader)
    with ambient():
        with_way, exact = (shaded(shader, image, alpha, want) for want in (Want.GRADIENTS, Want.EXACT))
    assert torch.equal(with_way.color, exact.color)
    assert not with_way.color.requires_grad


def test_gradients_agree_with_finite_differences(name: str):
    shader = shader_of(name, torch.float64)
    image, alpha = image_of(shader, torch.float64)
    into, given = Gradients(), shaded(shader, image, alpha, Want.GRADIENTS)
    grad_image, grad_alpha = given.backward(upstream(given.color), into)
    found = channels_of(shader, grad_image) | {n: dense(gradient) for n, gradient in into.items()}
    leaves = channels_of(shader, image) | {SHADER + n: parameter for n, parameter in shader.named_parameters()}
    if grad_alpha is not None:
        leaves["alpha"], found["alpha"] = alpha, grad_alpha
    assert found.keys() == leaves.keys()
    assert all(gradient.isfinite().all() for gradient in found.values())
    constant = CONSTANT.get(name, ())
    assert {n for n, gradient in found.items() if not gradient.any()} == set(constant)
    # What reaches alpha through a constant shows in differences, and not in its gradient.
    held = {n: leaf for n, leaf in leaves.items() if n not in constant and not (constant and n == "alpha")}
    differs = slopes_differ(lambda: _value(shader, image, alpha), held, found)
    assert max(differs.values(), default=0.0) < TOLERANCE, differs


def _value(shader: nn.Module, image: Tensor, alpha: Tensor) -> Tensor:
    color = shaded(shader, image, alpha, Want.EXACT).color
    return (color * upstream(color)).sum()


def test_its_state_is_all_of_it(name: str):
    shader, again = shader_of(name), SHADERS[name]()
    again.load_state_dict(shader.state_dict())
    image, alpha = image_of(shader)
    assert torch.equal(shaded(again, image, alpha, Want.EXACT).color, shaded(shader, image, alpha, Want.EXACT).color)


def test_a_gaussian_alone_shows_a_colour(name: str):
    shader, count = shader_of(name), 6
    drawn = torch.Generator().manual_seed(4)
    channels = {channel: torch.rand(count, width, generator=drawn) for channel, width in shader.needs.items()}
    shown = shader.emitted(channels, torch.randn(count, 3, generator=drawn), VIEW)
    assert shown.shape == (count, 3)
    assert shown.isfinite().all()
