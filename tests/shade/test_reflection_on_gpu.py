"""Reflection shading by Triton's kernels: the values and gradients of torch in double precision."""

from dataclasses import replace

import pytest
import torch
from surfaces import BOX, buffers, camera
from torch import Tensor

import interpreted
from ringlight.core.gradients import Gradients, dense
from ringlight.core.want import Want
from ringlight.shade import reflection_on_gpu
from ringlight.shade.covered import FAINTEST_SHADED
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_kernel import fits_triton
from ringlight.shade.reflection_settings import ReflectionSettings

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
SMALL = ReflectionSettings(hidden=16, levels=(4, 7), features=4, latents=3)
PLANAR = -1
"""In place of a number of channels behind those that are read: each channel lies by itself."""

KINDS = {
    "plain": SMALL,
    "two shells": replace(SMALL, shells=2),
    "no parallax": replace(SMALL, parallax=False),
    "axes, no parallax": replace(SMALL, parallax=False, axis_nodes=3),
    "no direction, no latents": replace(SMALL, raw_direction=False, latents=0),
    "one hidden layer, odd features": replace(SMALL, hidden_layers=1, features=3),
    "axes, two shells": replace(SMALL, axis_nodes=6, shells=2),
    "as ringlight-mirror": ReflectionSettings(hidden=32, levels=(4, 8, 16), raw_direction=False, axis_nodes=16),
    "a network too wide for a kernel": replace(SMALL, hidden=160),
}


def shader_of(settings: ReflectionSettings, inside: bool = False) -> ReflectionShader:
    """With a light that has learned; its spheres around the box, or far off so that most rays pass by."""
    shader, drawn = ReflectionShader(settings, BOX), torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in shader.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=drawn)
        if settings.parallax:
            shader.sphere[:, 3] += 2.0 if inside else 0.0
    return shader


def image_of(settings: ReflectionSettings, shader: ReflectionShader) -> tuple[Tensor, Tensor]:
    """What was blended in double; one pixel has no normal, and none is covered or not by rounding."""
    blended = buffers(camera(), settings.latents, dtype=torch.float64)
    blended["normal"][3, 5] = 0
    blended["alpha"][(blended["alpha"] - FAINTEST_SHADED).abs() < 1e-6] = 1
    return torch.cat([blended[name] for name in shader.needs], -1).float().double(), blended["alpha"].float().double()


def outcome(shader: ReflectionShader, image: Tensor, alpha: Tensor) -> dict[str, Tensor]:
    shown, into = shader.shade(image, alpha, camera(), BACKGROUND, Want.GRADIENTS), Gradients()
    upstream = torch.randn(shown.color.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    by_image, by_alpha = shown.backward(upstream.to(shown.color), into)
    found = {name: dense(gradient) for name, gradient in into.items()}
    return found | {"color": shown.color, "image": by_image, "alpha": by_alpha}


@pytest.mark.parametrize("kind", KINDS)
def test_equals_torch(kind: str, monkeypatch: pytest.MonkeyPatch):
    check(KINDS[kind], shader_of(KINDS[kind]), 0, monkeypatch)


@pytest.mark.parametrize("padded", [3, PLANAR])
def test_channels_may_lie_otherwise(padded: int, monkeypatch: pytest.MonkeyPatch):
    check(SMALL, shader_of(SMALL), padded, monkeypatch)


def test_rays_that_pass_the_sphere_by(monkeypatch: pytest.MonkeyPatch):
    settings = KINDS["two shells"]
    check(settings, shader_of(settings, inside=True), 0, monkeypatch)


def test_programs_go_over_many_blocks(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(reflection_on_gpu, "MOST_PROGRAMS", 1)
    settings = KINDS["axes, two shells"]
    check(settings, shader_of(settings), 0, monkeypatch)


def test_what_is_not_learned_gets_no_gradient(monkeypatch: pytest.MonkeyPatch):
    as_on_a_gpu(monkeypatch)
    shader = shader_of(SMALL).to(interpreted.DEVICE)
    shader.mlp[0].weight.requires_grad_(False)
    shader.sphere.requires_grad_(False)
    found = outcome(shader, *(tensor.float().to(interpreted.DEVICE) for tensor in image_of(SMALL, shader)))
    assert not {"shader.mlp.0.weight", "shader.sphere"} & found.keys()
    assert {"shader.mlp.0.bias", "shader.mlp.2.weight", "shader.maps.0.levels.0"} <= found.keys()


@pytest.mark.parametrize("changes", [{"axis_nodes": 32}, {"depth_gradient": True}, {"ring": "full"}])
def test_what_the_kernels_do_not_take_is_torchs(changes: dict, monkeypatch: pytest.MonkeyPatch):
    as_on_a_gpu(monkeypatch)
    settings = replace(SMALL, **changes)
    assert not fits_triton(settings, torch.zeros(1))
    assert fits_triton(SMALL, torch.zeros(1))


def as_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ringlight.shade.reflection_kernel.runs_triton", lambda *_: True)


def check(settings: ReflectionSettings, shader: ReflectionShader, padded: int, monkeypatch: pytest.MonkeyPatch) -> None:
    image, alpha = image_of(settings, shader)
    expected = outcome(shader.double(), image, alpha)
    as_on_a_gpu(monkeypatch)
    there = torch.nn.functional.pad(image, (0, max(padded, 0))).float().to(interpreted.DEVICE)[..., : image.shape[-1]]
    if padded == PLANAR:
        there = image.float().to(interpreted.DEVICE).permute(2, 0, 1).contiguous().permute(1, 2, 0)
    found = outcome(shader.float().to(interpreted.DEVICE), there, alpha.float().to(interpreted.DEVICE))
    assert found.keys() == expected.keys()
    for name, truth in expected.items():
        scale = truth.abs().max().item()
        torch.testing.assert_close(found[name].cpu().double(), truth, rtol=0, atol=2e-4 * scale + 1e-9, msg=name)


def test_a_picture_without_a_surface_and_one_without_a_way_back(monkeypatch: pytest.MonkeyPatch):
    settings, shader = SMALL, shader_of(SMALL)
    image, alpha = (tensor.float() for tensor in image_of(settings, shader))
    expected = shader.shaded_by_torch(image, alpha, camera(), BACKGROUND, Want.PICTURE).color
    as_on_a_gpu(monkeypatch)
    there = shader.to(interpreted.DEVICE)
    shown = there.shade(
        image.to(interpreted.DEVICE), alpha.to(interpreted.DEVICE), camera(), BACKGROUND, Want.PICTURE
    )  # fmt: skip
    torch.testing.assert_close(shown.color.cpu(), expected.detach(), rtol=0, atol=1e-5)
    empty = outcome(there, image.to(interpreted.DEVICE), torch.zeros_like(alpha).to(interpreted.DEVICE))
    assert torch.equal(empty["color"].cpu(), image[..., :3])
    assert all((empty[name] == 0).all() for name in empty if name.startswith("shader."))
