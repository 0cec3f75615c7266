"""The fader is honest for every method, and looking changes no bit."""

import pytest
import torch
from recorded_page import LIT_AFTER, trained

from ringlight.core.rendering import Emission
from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.runs.verify import digest_of
from ringlight.view.model_picture import layers_of, model_picture
from tiny_scene import tiny_scene

PER_GAUSSIAN = ("3dgs", "ringlight-basis", "ringlight-ring")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=6, size=24)


@pytest.mark.parametrize("method", LIT_AFTER)
def test_one_is_the_picture_and_zero_the_base_colours(method: str, scene: Scene):
    model, camera, white = trained(method, scene).model, scene.test[0].camera, torch.ones(3)
    before = digest_of(model.state_dict())
    whole = model_picture(model, camera, white)
    assert torch.equal(whole, model.render(camera, white, Want.PICTURE).color.detach().clamp(0, 1))
    base = model_picture(model, camera, white, light=0.0)
    assert torch.equal(base, model_picture(model, camera, white, layer="base"))
    assert (whole - base).abs().max() > 0.01, "there is a light to fade"
    half, twice = (model_picture(model, camera, white, light=light) for light in (0.5, 2.0))
    between = (whole > 0.05) & (whole < 0.95) & (base > 0.05) & (base < 0.95)
    assert torch.allclose(half[between], (0.5 * (whole + base))[between], atol=0.02)
    away = between & (twice > 0) & (twice < 1)
    assert torch.allclose((twice - whole)[away], (whole - base)[away], atol=0.04)
    for layer in layers_of(model, camera):
        found = model_picture(model, camera, white, layer=layer)
        assert found.shape == (24, 24, 3)
        assert found.min() >= 0
        assert found.max() <= 1
    assert digest_of(model.state_dict()) == before


@torch.no_grad()
@pytest.mark.parametrize("method", PER_GAUSSIAN)
@pytest.mark.parametrize("light", [0.3, 1.7])
def test_a_faded_picture_is_that_of_faded_gaussians(method: str, light: float, scene: Scene):
    """The slow twin: each Gaussian's own colour is faded, and then blended."""
    model, camera, black = trained(method, scene).model, scene.test[0].camera, torch.zeros(3)
    table = model.gaussians
    emission = model.color.emit(table, camera, ("rgb",), Want.EXACT)
    base = model.color.layers(table, camera)["base"]
    faded = base + light * (emission.channels - base)
    raster = model.rasterize.draw(
        table, Emission({"rgb": 3}, faded, emission.opacity_factor), camera, black, model.options
    )
    found = model_picture(model, camera, black, light=light)
    assert torch.allclose(found, raster.image.clamp(0, 1), atol=2e-5)


@torch.no_grad()
def test_a_faded_mirror_reflects_less(scene: Scene):
    """The slow twin: what the shader's reference adds to the blended base colours, times the factor."""
    model, camera, white = trained("ringlight-mirror", scene).model, scene.test[0].camera, torch.ones(3)
    shown = model.render(camera, white, Want.EXACT, tuple(model.shader.needs))
    reference = model.shader.reference({**shown.buffers, "alpha": shown.alpha}, camera, white)
    base = model.layers(camera)["base"] + (1 - shown.alpha)
    found = model_picture(model, camera, white, light=0.4)
    assert torch.allclose(found, (base + 0.4 * (reference - base)).clamp(0, 1), atol=1e-3)


def test_a_layer_that_there_is_not_is_the_picture(scene: Scene):
    model, camera, white = trained("3dgs", scene, 2).model, scene.test[0].camera, torch.ones(3)
    assert torch.equal(model_picture(model, camera, white, layer="modulation"), model_picture(model, camera, white))
