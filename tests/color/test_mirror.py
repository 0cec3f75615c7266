"""What the mirror's Gaussians emit, before and after the shader is switched on."""

import pytest
import torch

from ringlight.color.contract import ColorModel
from ringlight.color.mirror import FLIP_BELOW, Mirror, facing_normals
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.models.initial import gaussians_from_points
from torch_graph import channels

CAMERA = Camera(torch.eye(4), (30.0, 30.0), (12.5, 8.5), 24, 16)


def table(count: int = 200) -> tuple[Mirror, Gaussians]:
    """Gaussians before the camera, with normals in all directions, of lengths from 0.5 to 2."""
    random = torch.Generator().manual_seed(0)
    positions = torch.randn(count, 3, generator=random) + torch.tensor([0.0, 0.0, 6.0])
    normals = normalize(torch.randn(count, 3, generator=random))
    color = Mirror(latents=4, seed=1)
    points = PointCloud(positions, torch.rand(count, 3, generator=random), normals)
    gaussians = gaussians_from_points(points, color)
    gaussians.appearance["normals"] *= 0.5 + 1.5 * torch.rand(count, 1, generator=random)
    return color, gaussians


def test_channels_have_the_shaders_names_widths_and_units():
    color, gaussians = table()
    assert isinstance(color, ColorModel)
    channels = color.emit(gaussians, CAMERA, tuple(color.emits), Want.EXACT).named()
    widths = {name: values.shape[-1] for name, values in channels.items()}
    assert widths == color.emits == {"rgb": 3, "normal": 3, "latents": 4, "depth": 1}
    torch.testing.assert_close(channels["normal"].norm(dim=-1), torch.ones(200))
    torch.testing.assert_close(channels["depth"][:, 0], gaussians.means[:, 2])


@pytest.mark.parametrize("want", Want)
def test_base_colours_alone_are_those_among_all(want: Want):
    color, gaussians = table()
    alone = color.emit(gaussians, CAMERA, ("rgb",), want)
    assert alone.widths == {"rgb": 3}
    every = color.emit(gaussians, CAMERA, ("rgb", "normal"), want).named()["rgb"]
    torch.testing.assert_close(alone.channels, every, rtol=0, atol=1e-6)
    assert torch.equal(alone.channels, gaussians.appearance["base"].sigmoid())


def test_base_colours_start_as_the_points():
    points = PointCloud(torch.randn(9, 3), torch.cat([torch.zeros(1, 3), torch.ones(1, 3), torch.rand(7, 3)]))
    columns = Mirror(latents=2).new_columns(points)
    torch.testing.assert_close(columns["base"].sigmoid(), points.colors, atol=0.5 / 255, rtol=0)
    assert columns["latents"].shape == (9, 2)


def test_latents_are_drawn_by_the_seed():
    points = PointCloud(torch.randn(9, 3), torch.rand(9, 3))
    drawn = [Mirror(latents=4, seed=seed).new_columns(points)["latents"] for seed in (0, 0, 1)]
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])


def test_points_without_normals_get_those_of_a_ball():
    positions = normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(2))) + 3
    normals = Mirror(latents=0).new_columns(PointCloud(positions, torch.rand(500, 3)))["normals"]
    assert ((normals * (positions - 3)).sum(-1) > 0.98).all()


def test_only_normals_that_clearly_look_away_are_turned():
    _, gaussians = table()
    towards = -view_directions(gaussians.means, CAMERA.position)
    own = normalize(gaussians.appearance["normals"])
    shown = facing_normals(gaussians.means, gaussians.appearance["normals"], CAMERA)
    before, after = (own * towards).sum(-1), (shown * towards).sum(-1)
    away = before < FLIP_BELOW
    assert away.any()
    assert (~away & (before < 0)).any()
    torch.testing.assert_close(after[away], -before[away])
    torch.testing.assert_close(after[~away], before[~away])


def test_gradients_reach_normals_latents_and_places():
    color, gaussians = table(10)
    leaves = {name: column.requires_grad_() for name, column in gaussians.columns().items()}
    emitted = channels(color, Gaussians.from_columns(leaves), CAMERA)
    weights = torch.randn(10, 11, generator=torch.Generator().manual_seed(3))
    (torch.cat(list(emitted.values()), -1) * weights).sum().backward()
    assert all(leaves[name].grad.abs().sum() > 0 for name in ("base", "normals", "latents", "means"))
    # A normal's length is free: its gradient is across it.
    across = (leaves["normals"].grad * leaves["normals"]).sum(-1)
    torch.testing.assert_close(across, torch.zeros(10), atol=1e-5, rtol=0)


def test_layers_are_base_and_normal():
    color, gaussians = table()
    layers = color.layers(gaussians, CAMERA)
    torch.testing.assert_close(layers["base"], gaussians.appearance["base"].sigmoid())
    torch.testing.assert_close(
        layers["normal"], facing_normals(gaussians.means, gaussians.appearance["normals"], CAMERA)
    )
    assert color.wanted(gaussians).all()
