"""The fused reflection shader against its torch reference in float64, in value and in every gradient.

ReLU, the cells of maps and the square's folds have kinks where float32 and float64 may take different sides; the
comparison allows for a few such pixels where one wrong side shows at all. Where layers multiply in bfloat16, tolerances
are wider and hidden units are kept from their kinks by large biases; tests/test_isa.py runs the same code on floats.
"""

from dataclasses import dataclass, replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import BOX, buffers, camera
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels
from ringlight.core.want import Want
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_kernel import kernel_takes
from ringlight.shade.reflection_settings import ReflectionSettings
from torch_graph import image_of, shaded

BF16 = _kernels.isa() in ("avx512_bf16", "avx512_amx")
VALUE_TOLERANCE = 0.03 if BF16 else 2e-5
"""Of the largest value; of hidden units with far biases bfloat16 keeps two digits. Single precision through base
colours divided by a small alpha gives some 2e-6."""
GRADIENT_TOLERANCE = 0.15 if BF16 else 2e-4
"""Of the largest entry of each gradient."""
KINKED = 0.05 if BF16 else 2e-5
"""Of the largest entry of a gradient: a pixel that differs by more stands on two sides of a kink."""
FEWEST = 9 if BF16 else 1
"""Hidden units, and pixels a side: sums of a few that cancel keep no digit of bfloat16."""
FAR_BIAS = 30.0
"""More than a hidden unit's inputs add up to, and four times as much in the next layer."""

SMALL = ReflectionSettings(hidden=16, levels=(4, 7), features=4, latents=3)
GREY = torch.tensor([0.5, 0.4, 0.3])


@dataclass(frozen=True)
class Result:
    color: Tensor
    gradients: dict[str, Tensor]


def shader_with(chosen: ReflectionSettings, seed: int = 0, far_from_kinks: bool = True) -> ReflectionShader:
    """Larger features than new ones, so that directions count."""
    shader = ReflectionShader(chosen, BOX, seed)
    with torch.no_grad():
        for parameter in shader.maps.parameters():
            parameter.mul_(30)
        if chosen.axis_nodes:
            shader.places.axes.normal_(1, 0.3, generator=torch.Generator().manual_seed(seed))
        if BF16 and far_from_kinks:
            leave_kinks(shader)
        if chosen.parallax:
            shader.sphere.add_(torch.randn(shader.sphere.shape, generator=torch.Generator().manual_seed(seed)) * 0.1)
    return shader


def leave_kinks(shader: ReflectionShader) -> None:
    """Every second hidden unit on, the others off, whatever the input."""
    *hidden, _ = [layer for layer in shader.mlp if isinstance(layer, nn.Linear)]
    for depth, layer in enumerate(hidden):
        signs = torch.where(torch.arange(len(layer.bias)) % 2 == 0, 1.0, -1.0)
        layer.bias.copy_(FAR_BIAS * 4**depth * signs)


def run(shader: ReflectionShader, blended: Channels, view: Camera, seed: int = 0) -> Result:
    """The kernel for float32, the reference for float64."""
    shader.zero_grad()
    leaves = {name: values.detach().clone().requires_grad_() for name, values in blended.items()}
    color = shaded(shader, leaves, view, GREY)
    upstream = torch.randn(color.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    color.backward(upstream.to(color))
    gradients = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    gradients |= {name: p.grad.clone() for name, p in shader.named_parameters() if p.grad is not None}
    return Result(color.detach(), gradients)


def smooth(shader: ReflectionShader, blended: Channels, view: Camera) -> Channels:
    """The buffers without the pixels at which the two precisions differ much: they stand on two sides of a kink."""
    double = {name: values.double() for name, values in blended.items()}
    single_result = run(shader, blended, view)
    double_result = run(shader.double(), double, view)
    shader.float()
    name = "normal"
    gap = (single_result.gradients[name] - double_result.gradients[name]).abs().amax(-1)
    kinked = gap > KINKED * double_result.gradients[name].abs().max()
    covered = blended["alpha"][..., 0] > 0
    assert kinked.sum() <= max(0.05 * covered.sum(), min(2, covered.sum() - 1)), "kinks are rare, and a pixel is left"
    return {n: torch.where(kinked[..., None], 0, values) for n, values in blended.items()}


def assert_equal(shader: ReflectionShader, blended: Channels, view: Camera) -> None:
    blended = smooth(shader, blended, view)
    found = run(shader, blended, view)
    expected = run(shader.double(), {name: values.double() for name, values in blended.items()}, view)
    shader.float()
    assert found.color.dtype == torch.float32
    scale = expected.color.abs().max()
    assert (found.color - expected.color).abs().max() <= VALUE_TOLERANCE * scale
    if not shader.settings.depth_gradient and "depth" in shader.needs:
        assert not any(result.gradients.pop("depth").any() for result in (found, expected))
    assert found.gradients.keys() == expected.gradients.keys()
    for name, gradient in expected.gradients.items():
        if not gradient.numel():  # of latents that there are none of
            continue
        error = (found.gradients[name] - gradient).abs().max().item()
        assert error <= GRADIENT_TOLERANCE * gradient.abs().max().item() + 1e-7, name


KINDS = {
    "plain": SMALL,
    "two shells": replace(SMALL, shells=2),
    "no parallax": replace(SMALL, parallax=False),
    "no direction, no latents": replace(SMALL, raw_direction=False, latents=0),
    "depth": replace(SMALL, depth_gradient=True, shells=2),
    "one hidden layer": replace(SMALL, hidden_layers=1),
    "axes": replace(SMALL, axis_nodes=5),
    "axes, depth": replace(SMALL, axis_nodes=5, depth_gradient=True),
    "axes, no parallax": replace(SMALL, axis_nodes=5, depth_gradient=True, parallax=False),
    "default": ReflectionSettings(),
    "mirror": replace(RingLightMirrorRecipe().shader, gradient_share=1.0),
    "narrow": ReflectionSettings(hidden=32, levels=(16, 64), features=8),
    "widest": ReflectionSettings(hidden=128, levels=(2, 3, 4, 5, 6, 7, 8, 9), features=16, latents=16, shells=2),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(1, 1), (13, 9), (70, 41)])
def test_equals_the_reference(kind: str, size: tuple[int, int]):
    chosen, view = KINDS[kind], camera(*size)
    blended = buffers(view, chosen.latents)
    assert kernel_takes(chosen, *blended.values())
    assert_equal(shader_with(chosen), blended, view)


@pytest.mark.parametrize("kind", KINDS)
def test_any_wish_gives_the_same_bits(kind: str):
    chosen, view = KINDS[kind], camera(70, 41)
    shader, blended = shader_with(chosen), buffers(view, chosen.latents)
    image, alpha = image_of(shader, blended), blended["alpha"]
    shown = [shader.shade(image, alpha, view, GREY, want).color for want in Want]
    with torch.no_grad():
        shown += [shader.shade(image, alpha, view, GREY, want).color for want in Want]
    assert all(torch.equal(other, shown[0]) for other in shown[1:])
    assert not any(color.requires_grad for color in shown)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_importance_sampled_pixels_are_the_references(share: float):
    """The same lots, for they are made of the same bits."""
    chosen, view = replace(SMALL, gradient_share=share, axis_nodes=5), camera(70, 41)
    shader = shader_with(chosen)
    blended = smooth(shader_with(replace(SMALL, axis_nodes=5)), buffers(view, chosen.latents), view)
    found = run(shader, blended, view)
    leaves = {name: values.double().requires_grad_() for name, values in blended.items()}
    exact = shader.double()
    color = exact.reference(leaves, view, GREY, share)
    exact.zero_grad()
    upstream = torch.randn(color.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    color.backward(upstream)
    expected = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    expected |= {name: p.grad for name, p in exact.named_parameters()}
    undrawn = (found.gradients["normal"] == 0).all(-1) & (blended["normal"] != 0).any(-1)
    assert 0.5 * (1 - share) < undrawn.float().mean()
    for name, gradient in expected.items():
        error = (found.gradients[name] - gradient).abs().max()
        assert error <= GRADIENT_TOLERANCE * gradient.abs().max() + 1e-7, name


@given(
    hidden=st.integers(FEWEST, 40),
    layers=st.integers(1, 2),
    latents=st.integers(0, 5),
    levels=st.lists(st.integers(2, 12), min_size=1, max_size=3),
    quads=st.integers(1, 3),
    shells=st.integers(0, 2),
    axis_nodes=st.sampled_from([0, 2, 3, 9]),
    flags=st.tuples(st.booleans(), st.booleans()),
    size=st.tuples(st.integers(FEWEST, 40), st.integers(FEWEST, 20)),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40, derandomize=True)
def test_equals_the_reference_for_any_shape(
    hidden: int, layers: int, latents: int, levels: list[int], quads: int, shells: int, axis_nodes: int,
    flags: tuple[bool, bool], size: tuple[int, int], seed: int,
):  # fmt: skip
    chosen = ReflectionSettings(
        hidden=hidden, hidden_layers=layers, latents=latents, levels=tuple(levels), features=4 * quads,
        shells=max(shells, 1), parallax=shells > 0, axis_nodes=axis_nodes,
        raw_direction=flags[0], depth_gradient=flags[1],
    )  # fmt: skip
    view = camera(*size)
    assert_equal(shader_with(chosen, seed), buffers(view, latents, seed), view)


def test_the_default_shader_differs_from_its_exact_reference_by_less_than_a_thousandth_of_the_range():
    view, shader = camera(60, 40), shader_with(ReflectionSettings(), far_from_kinks=False)
    blended = buffers(view)
    blended["alpha"] = (blended["alpha"] > 0).to(blended["rgb"])
    double = {name: values.double() for name, values in blended.items()}
    with torch.no_grad():
        shader.mlp[-1].weight.mul_(5)  # residuals as large as learned ones
        fast, slow = shaded(shader, blended, view, GREY), shaded(shader.double(), double, view, GREY)
    assert (slow - double["rgb"]).square().mean().sqrt() > 0.02
    assert (fast - slow).square().mean().sqrt() <= 1e-3


def test_a_picture_without_surface_is_handed_on():
    view, shader = camera(), ReflectionShader(SMALL, BOX)
    blended = buffers(view, 3)
    blended["alpha"] = torch.zeros_like(blended["alpha"])
    result = run(shader, blended, view)
    assert torch.equal(result.color, blended["rgb"])
    assert not any(gradient.any() for name, gradient in result.gradients.items() if name != "rgb")


def test_the_same_bits_for_any_number_of_threads():
    view = camera(300, 200)
    shader = shader_with(ReflectionSettings(hidden=8, levels=(4, 9), shells=2, axis_nodes=5))
    blended = buffers(view)
    before, results = _kernels.threads(), []
    try:
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            results.append(run(shader, blended, view))
    finally:
        _kernels.set_threads(before)
    for other in results[1:]:
        assert torch.equal(other.color, results[0].color)
        assert all(torch.equal(other.gradients[name], g) for name, g in results[0].gradients.items())


@pytest.mark.parametrize("chosen", [replace(SMALL, features=6), replace(SMALL, hidden=200), replace(SMALL, latents=20)])
def test_what_the_kernel_cannot_do_the_reference_does(chosen: ReflectionSettings):
    view = camera(5, 4)
    blended = buffers(view, chosen.latents)
    assert not kernel_takes(chosen, *blended.values())
    assert shaded(ReflectionShader(chosen, BOX), blended, view, GREY).shape == (4, 5, 3)
