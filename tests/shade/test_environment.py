"""The environment's kernel against its reference, and what a cubemap without a seam means."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import buffers, camera
from torch import Tensor

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.core.gradients import Gradients, dense
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.shade.environment import EnvironmentShader

GREY = torch.tensor([0.5, 0.4, 0.3])
ROUNDING = 1e-5
"""Of the largest value: a place on a face is a difference of numbers of its side's size."""


def picture(width: int, height: int, seed: int) -> tuple[Tensor, Tensor]:
    """Planes of rgb, normal and strength over pixels of all opacities, and alpha; float64."""
    drawn = torch.Generator().manual_seed(seed)
    blended = buffers(camera(width, height), 0, dtype=torch.float64)
    strength = torch.rand(height, width, 1, generator=drawn, dtype=torch.float64) * blended["alpha"]
    return torch.cat([blended["rgb"], blended["normal"], strength], -1), blended["alpha"]


@settings(max_examples=12, deadline=None)
@given(side=st.integers(1, 40), width=st.integers(1, 37), height=st.integers(1, 19), seed=st.integers(0, 99))
def test_the_kernel_has_values_and_gradients_of_the_reference(side: int, width: int, height: int, seed: int):
    image, alpha = picture(width, height, seed)
    upstream = torch.randn(height, width, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    found = []
    for dtype in (torch.float32, torch.float64):
        shader, into = EnvironmentShader(side, seed).to(dtype), Gradients()
        given_image = image.float().to(dtype)
        shaded = shader.shade(given_image, alpha.float().to(dtype), camera(width, height), GREY, Want.GRADIENTS)
        grad_image, grad_alpha = shaded.backward(upstream.to(dtype), into)
        assert grad_alpha is None or not grad_alpha.any()
        found.append((shaded.color.double(), grad_image.double(), dense(into["shader.texels"]).double()))
    for kernel, reference in zip(*found, strict=True):
        assert (kernel - reference).abs().max() <= ROUNDING * max(side, 8) * reference.abs().max() + 1e-7


def test_a_picture_without_pixels_is_refused():
    negative = _kernels.Camera(
        world_to_camera=torch.eye(4), position=torch.zeros(3), focal=(4.0, 4.0), center=(2.0, 1.5), width=-4, height=-3
    )
    view = _kernels.EnvironmentView(camera=negative, faintest=0.1, shortest_normal=0.1)
    with pytest.raises(ValueError, match="no pixels"):
        _kernels.environment_forward(
            view, torch.zeros(6, 3, 3, 4), torch.zeros(7, 3, 4), torch.zeros(1, 3, 4), torch.zeros(3, 3, 4)
        )


@pytest.mark.parametrize("side", [1, 2, 5, 16])
def test_colours_do_not_jump_between_faces(side: int):
    shader = EnvironmentShader(side, 3).double()
    drawn = torch.Generator().manual_seed(1)
    on_edges = torch.rand(500, 3, generator=drawn, dtype=torch.float64) * 2 - 1
    on_edges[:, :2] = on_edges[:, :2].sign()
    on_edges[:100] = on_edges[:100].sign()  # corners
    on_edges = on_edges.gather(1, torch.rand(500, 3, generator=drawn).argsort(1))
    nudge = 1e-9 * torch.randn(500, 3, generator=drawn, dtype=torch.float64)
    a, b = (shader.seen(normalize(on_edges + sign * nudge)) for sign in (1, -1))
    assert (a - b).abs().max() < 1e-6


def test_a_texel_is_seen_in_its_own_direction():
    shader = EnvironmentShader(4, 3)
    with torch.no_grad():
        shader.texels.fill_(-20.0)
        shader.texels[3, 0, 2] = 20.0  # -y, columns along x, rows along z
    towards = torch.tensor([[0.25, -1.0, -0.75]])
    assert shader.seen(normalize(towards)).min() > 0.999
    assert shader.seen(-towards).max() < 1e-3


def test_a_side_that_no_kernel_takes_is_refused():
    for side in (0, 1025):
        with pytest.raises(RecipeError, match="give 1 to 1024"):
            EnvironmentShader(side)
