"""A splat model's layers mean what they say, and the background is for the colour alone."""

import pytest
import torch
from torch import Tensor

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Channels, Shaded
from ringlight.core.sh_basis import sh_from_rgb
from ringlight.core.want import Want
from ringlight.models.splats import SplatModel
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.shade.passthrough import PassThrough

CAMERA = Camera(torch.eye(4), (30.0, 30.0), (12.5, 8.5), 24, 16)
MIDDLE, CORNER = (8, 12), (0, 0)
RED = torch.tensor([[0.8, 0.1, 0.2]])


@pytest.fixture
def disc() -> SplatModel:
    """One disc, three units before the camera, thin along z; one behind the camera."""
    table = Gaussians(
        torch.tensor([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]]),
        torch.tensor([[-2.0, -2.0, -5.0]]).repeat(2, 1),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(2, 1),
        torch.tensor([0.8, 0.8]).logit(),
        {"sh_dc": sh_from_rgb(RED).repeat(2, 1), "sh_rest": torch.zeros(2, 15, 3)},
    )
    return SplatModel(table, SphericalHarmonics(), PassThrough(), ReferenceRasterizer())


def test_depth_is_camera_z_and_normals_face_the_camera(disc: SplatModel):
    layers = disc.layers(CAMERA)
    assert {"alpha", "depth", "normal", "base", "residual"} <= set(layers)
    assert layers["depth"][MIDDLE].item() == pytest.approx(3.0, rel=1e-4)
    torch.testing.assert_close(layers["normal"][MIDDLE], torch.tensor([0.0, 0.0, -1.0]))
    assert layers["alpha"][MIDDLE].item() == pytest.approx(0.8, rel=1e-5)
    assert [layers[name][CORNER].abs().sum().item() for name in ("alpha", "depth", "normal")] == [0.0, 0.0, 0.0]


def test_base_and_residual_lie_over_black(disc: SplatModel):
    layers = disc.layers(CAMERA)
    alpha = layers["alpha"][MIDDLE]
    torch.testing.assert_close(layers["base"][MIDDLE], RED[0] * alpha)
    assert layers["residual"].abs().max() < 1e-6


class Brighter(PassThrough):
    """A deferred shader that adds a constant where there is a surface."""

    adds_light = True

    def shade(
        self, image: Tensor, alpha: Tensor, camera: Camera, background: Tensor, want: Want, shaded=None
    ) -> Shaded:
        return Shaded(image + 0.1 * alpha)

    def emitted(self, channels: Channels, points: Tensor, camera: Camera) -> Tensor:
        return channels["rgb"] + 0.1


class Plain(SphericalHarmonics):
    """A colour model that leaves the residual to the shader, and knows its normals."""

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        return {"normal": torch.tensor([[0.6, 0.0, -0.8]]).expand(len(gaussians), 3)}


def test_what_the_shader_adds_is_the_residual_and_normals_are_the_color_models(disc: SplatModel):
    model = SplatModel(disc.gaussians, Plain(), Brighter(), ReferenceRasterizer())
    layers = model.layers(CAMERA)
    torch.testing.assert_close(layers["residual"], 0.1 * layers["alpha"].expand(-1, -1, 3))
    torch.testing.assert_close(layers["normal"][MIDDLE], torch.tensor([0.6, 0.0, -0.8]))


def test_harmonics_are_exact_where_no_shader_adds_light(disc: SplatModel):
    assert disc.harmonics(disc.gaussians) is not None
    brighter = SplatModel(disc.gaussians, Plain(), Brighter(), ReferenceRasterizer())
    assert brighter.harmonics(disc.gaussians) is None


def test_the_background_shows_where_nothing_is(disc: SplatModel):
    background = torch.tensor([0.2, 0.4, 0.6])
    rendering = disc.render(CAMERA, background)
    torch.testing.assert_close(rendering.color[CORNER], background)
    alpha = rendering.alpha[MIDDLE]
    torch.testing.assert_close(rendering.color[MIDDLE], RED[0] * alpha + background * (1 - alpha))


def test_columns_of_any_number_of_rows_are_taken(disc: SplatModel):
    rows = {name: column[:1] for name, column in disc.columns.items()}
    disc.load_columns(rows)
    assert len(disc) == len(disc.gaussians) == 1
    assert all(torch.equal(column, rows[name]) and column.requires_grad for name, column in disc.columns.items())
