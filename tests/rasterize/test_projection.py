"""Projection: ellipses equal gsplat's, and Gaussians are culled exactly where nothing of them could be seen."""

import numpy as np
import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.projection import project
from shared_data import shared

CAMERA = Camera(torch.eye(4), (50.0, 60.0), (20.0, 15.0), 40, 30)


def one_gaussian(mean=(0.0, 0.0, 2.0), scale: float = 0.1, opacity: float = 0.5) -> Gaussians:
    logit = torch.tensor([opacity], dtype=torch.float64).logit()
    scales = torch.full((1, 3), scale, dtype=torch.float64)
    quats = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64)
    return Gaussians(torch.tensor([mean], dtype=torch.float64), scales.log(), quats, logit)


@pytest.mark.parametrize("name", ["classic_153", "antialiased_153", "near_153"])
def test_ellipses_equal_the_oracle(name: str):
    with np.load(shared(f"oracle/{name}.npz")) as file:
        arrays = {key: torch.from_numpy(np.asarray(file[key])) for key in file.files}
    scales, opacities = arrays["in_scales"].double().log(), arrays["in_opacities"].double().logit()
    gaussians = Gaussians(arrays["in_means"].double(), scales, arrays["in_quats"].double(), opacities)
    (fx, _, cx), (_, fy, cy) = arrays["in_K"].double()[:2].tolist()
    camera = Camera(arrays["in_viewmat"], (fx, fy), (cx, cy), 128, 128)
    projection = project(gaussians, camera, RasterOptions(antialiased=name.startswith("antialiased")))
    drawn = projection.on_image(camera, 0.01)
    assert torch.equal(drawn, (arrays["radii"] > 0).all(1))
    for field, key in (("means2d", "means2d"), ("conics", "conics"), ("depths", "depths")):
        torch.testing.assert_close(getattr(projection, field)[drawn], arrays[key][drawn], rtol=1e-10, atol=1e-12)
    assert torch.equal(projection.radii[drawn].long(), arrays["radii"][drawn].long())


def test_an_isotropic_gaussian_on_the_axis_has_the_textbook_ellipse():
    projection = project(one_gaussian(), CAMERA, RasterOptions(eps2d=0.3))
    # Standard deviation in pixels is focal * scale / depth.
    expected = [1 / (2.5**2 + 0.3), 0, 1 / (3.0**2 + 0.3)]
    assert projection.means2d[0].tolist() == [20.0, 15.0]
    assert projection.conics[0].tolist() == pytest.approx(expected)
    # It fades below 1/255 at sqrt(2 ln(255/2)) = 3.114 standard deviations.
    assert projection.radii[0].tolist() == [np.ceil(3.114 * 6.55**0.5), np.ceil(3.114 * 9.3**0.5)]


def test_antialiasing_scales_the_opacity_by_what_the_blur_adds_to_the_area():
    projection = project(one_gaussian(), CAMERA, RasterOptions(antialiased=True))
    assert projection.opacities.item() == pytest.approx(0.5 * (2.5 * 3.0) / (6.55 * 9.3) ** 0.5)


@pytest.mark.parametrize(
    ("gaussian", "drawn"),
    [
        (one_gaussian(), True),
        (one_gaussian(mean=(0, 0, -2)), False),
        (one_gaussian(mean=(0, 0, 0.009)), False),
        (one_gaussian(mean=(0, 0, 0.011)), True),
        (one_gaussian(opacity=0.0039), False),
        (one_gaussian(opacity=0.0040), True),
        # The ellipse reaches 9 pixels; the centre lies 9.05 and 8.95 beside the image.
        (one_gaussian(mean=(-1.162, 0, 2)), False),
        (one_gaussian(mean=(-1.158, 0, 2)), True),
        (one_gaussian(scale=1e200), False),
    ],
)
def test_what_is_culled(gaussian: Gaussians, drawn: bool):
    projection = project(gaussian, CAMERA, RasterOptions())
    assert projection.on_image(CAMERA, near=0.01).item() is drawn


def test_beside_the_image_the_affine_approximation_stops_growing():
    """x/z is clamped to the image's edge plus 0.3 tan(fov/2): 20/50 + 0.3 * 20/50 = 0.52."""
    inside, outside = (project(one_gaussian(mean=(x, 0, 2)), CAMERA, RasterOptions()) for x in (1.04, 3.0))
    torch.testing.assert_close(outside.conics, inside.conics)
