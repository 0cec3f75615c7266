"""The reflection shader in torch: what it means, and that its gradients are those of its values."""

from dataclasses import replace

import pytest
import torch
from surfaces import BOX, buffers, camera

from finite_differences import assert_gradients
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.gradients import Gradients
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import RingSettings
from ringlight.shade.contract import Shader
from ringlight.shade.covered import FAINTEST_SHADED, covered_pixels
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_settings import ReflectionSettings
from torch_graph import shaded

TINY_RING = RingSettings(
    rank=2, features=3, head_hidden=8, bands=2, view_bands=2, position_nodes=5, view_nodes=4, core_scale=1.0
)
SMALL = ReflectionSettings(hidden=16, levels=(4, 7), features=4, latents=3)
GREY, BLACK = torch.full((3,), 0.5), torch.zeros(3)
KINDS = {
    "plain": SMALL,
    "two shells": replace(SMALL, shells=2),
    "no parallax": replace(SMALL, parallax=False),
    "no direction, no latents": replace(SMALL, raw_direction=False, latents=0),
    "one hidden layer": replace(SMALL, hidden_layers=1),
    "depth": replace(SMALL, depth_gradient=True),
    "axes": replace(SMALL, axis_nodes=6, shells=2),
    "axes, depth": replace(SMALL, axis_nodes=6, depth_gradient=True),
    "ring": replace(SMALL, ring="full", near_field=TINY_RING),
    "diagonal ring": replace(SMALL, ring="diagonal", near_field=TINY_RING),
}


def test_it_is_a_shader_and_hands_the_base_colour_on_during_the_warm_up():
    shader = ReflectionShader(SMALL, BOX)
    assert isinstance(shader, Shader)
    shader.lit.fill_(False)
    assert shader.needs == {"rgb": 3}
    image = buffers(camera(), 3)["rgb"]
    for want in Want:
        shown = shader.shade(image, torch.ones_like(image[..., :1]), camera(), GREY, want)
        assert shown.color is image
        assert shown.backward(image, Gradients()) == (image, None)


def test_only_pixels_that_are_opaque_enough_are_shaded():
    blended = buffers(camera(), 3)
    blended["alpha"][2, 3], blended["alpha"][2, 4] = FAINTEST_SHADED, 1.01 * FAINTEST_SHADED
    changed = (shaded(ReflectionShader(SMALL, BOX), blended, camera(), GREY) != blended["rgb"]).any(-1)
    assert torch.equal(changed, blended["alpha"][..., 0] > FAINTEST_SHADED)


def test_what_is_added_does_not_depend_on_the_background():
    view, shader = camera(), ReflectionShader(SMALL, BOX)
    blended = buffers(view, 3)
    over_black = blended | {"rgb": blended["rgb"] - (1 - blended["alpha"]) * GREY}
    on_grey = shaded(shader, blended, view, GREY) - blended["rgb"]
    on_black = shaded(shader, over_black, view, BLACK) - over_black["rgb"]
    torch.testing.assert_close(on_black, on_grey, rtol=0, atol=1e-5)


def test_surfaces_are_where_the_camera_saw_them():
    view = camera()
    pixels = covered_pixels(buffers(view), view, GREY, False)
    torch.testing.assert_close(pixels.directions, view.ray_directions().flatten(0, 1)[pixels.index], rtol=0, atol=1e-6)
    depths = buffers(view)["depth"] / buffers(view)["alpha"]
    torch.testing.assert_close(view.depths(pixels.points), depths.flatten()[pixels.index], rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(normalize(pixels.points - view.position), pixels.directions, rtol=0, atol=1e-5)
    torch.testing.assert_close(pixels.normals.norm(dim=-1), torch.ones(len(pixels.index)))


def test_a_mirror_shows_what_stands_in_the_reflected_direction():
    """One level, one feature that is bright around +z; a network that hands the feature on."""
    settings = ReflectionSettings(hidden=1, levels=(33,), features=1, latents=0, parallax=False, raw_direction=False)
    shader = ReflectionShader(settings, BOX)
    with torch.no_grad():
        for parameter in shader.parameters():
            parameter.zero_()
        shader.maps[0].levels[0][16, 16] = 1
        shader.mlp[0].weight[0, -1] = 1
        shader.mlp[2].weight.fill_(1)
        shader.mlp[4].weight.fill_(1)
    view = Camera(torch.eye(4), (100.0, 100.0), (0.5, 0.5), 1, 1)  # one pixel, looking along +z
    blended = buffers(view, 0) | {"alpha": torch.ones(1, 1, 1), "rgb": torch.zeros(1, 1, 3)}
    for normal, expected in (((1.0, 0.0, 0.0), 1.0), ((0.0, 0.0, -1.0), 0.0), ((1.0, 0.0, -1.0), 0.0)):
        color = shaded(shader, blended | {"normal": torch.tensor([[normal]])}, view, BLACK)
        torch.testing.assert_close(color, torch.full((1, 1, 3), expected))


@pytest.mark.parametrize("kind", KINDS)
def test_gradients(kind: str):
    settings, view = KINDS[kind], camera(4, 3)
    shader = ReflectionShader(settings, BOX).double()
    with torch.no_grad():
        if settings.axis_nodes:
            shader.places.axes.normal_(1, 0.3, generator=torch.Generator().manual_seed(0))
    blended = buffers(view, settings.latents, dtype=torch.float64)
    blended["mean depth"] = blended["depth"] / blended["alpha"].clamp_min(FAINTEST_SHADED)
    leaves = {name: blended[name].clone() for name in blended if name != "depth"}
    for name, leaf in leaves.items():
        leaf.requires_grad_(name != "mean depth" or settings.depth_gradient)

    def color(*tensors: torch.Tensor) -> torch.Tensor:
        surface = dict(zip(leaves, tensors, strict=False))
        # With the depth's mean kept, numerical gradients see no way through the point where the analytical have none.
        return shader.reference(surface | {"depth": surface.pop("mean depth") * surface["alpha"]}, view, GREY)

    color(*leaves.values()).sum().backward()
    assert all(parameter.grad is not None for parameter in shader.parameters())
    assert_gradients(color, [*leaves.values(), *shader.parameters()])


@pytest.mark.parametrize("kind", KINDS)
def test_the_way_back_by_torch_is_autograds(kind: str):
    """What no kernel takes is shaded by the reference: the record's gradients are those of its plain graph."""
    settings, view = KINDS[kind], camera(7, 5)
    shader, blended = ReflectionShader(settings, BOX).double(), buffers(view, settings.latents, dtype=torch.float64)
    upstream = torch.randn(5, 7, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    found = []
    for color_of in (shader.reference, lambda *view: shaded(shader, *view)):
        leaves = {name: values.clone().requires_grad_() for name, values in blended.items()}
        shader.zero_grad()
        color = color_of(leaves, view, GREY)
        color.backward(upstream)
        gradients = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None and leaf.grad.any()}
        found.append([color.detach(), gradients | {name: p.grad for name, p in shader.named_parameters()}])
    (expected, by_graph), (color, by_record) = found
    assert torch.equal(color, expected)
    assert by_record.keys() == by_graph.keys()
    for name, gradient in by_graph.items():
        torch.testing.assert_close(by_record[name], gradient, rtol=1e-12, atol=1e-12)


def test_the_seed_decides_where_it_starts():
    first, again, other = (ReflectionShader(SMALL, BOX, seed).state_dict() for seed in (1, 1, 2))
    assert all(torch.equal(first[name], tensor) for name, tensor in again.items())
    assert not torch.equal(first["mlp.0.weight"], other["mlp.0.weight"])
    assert {name.split(".")[0] for name in first} == {"maps", "mlp", "sphere", "box", "lit"}


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"hidden": 0}, "hidden"),
        ({"hidden_layers": 3}, "hidden_layers"),
        ({"levels": ()}, "levels"),
        ({"levels": (8, 1)}, "side of 1"),
        ({"features": 0}, "features"),
        ({"latents": -1}, "latents"),
        ({"shells": 3}, "shells"),
        ({"shells": 2, "parallax": False}, "without parallax"),
        ({"axis_nodes": 1}, "axis_nodes is 1"),
        ({"axis_nodes": 5000}, "axis_nodes is 5000"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings: dict, word: str):
    with pytest.raises(RecipeError, match=word):
        ReflectionSettings(**settings)
