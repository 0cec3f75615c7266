"""The specification itself: equal to gsplat's own float64 reference, and its gradients to finite differences."""

import pytest
import torch
from torch import Tensor

from raster_oracle import ORACLES, load_oracle
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Footprint
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.reference import ReferenceRasterizer, blended
from torch_graph import drawn

# Both sides compute in float64: what remains is the order of the sums.
TOLERANCE = 1e-11


def blended_alone(
    gaussians: Gaussians,
    channels: Tensor,
    camera: Camera,
    background: Tensor,
    options: RasterOptions,
    factor: Tensor | None = None,
) -> tuple[Tensor, Tensor, Footprint]:
    """The specification without a record around it: plain autograd, also in the camera's pose."""
    columns = gaussians.columns() | {"channels": channels, "opacity_factor": factor}
    return blended(columns, camera, background, options)


def assert_equal_up_to_rounding(found: Tensor, expected: Tensor, what: str):
    error = (found - expected).abs().max() / expected.abs().max()
    assert error < TOLERANCE, f"{what}: {error:.1e} of the largest value"


@pytest.mark.parametrize("name", ORACLES)
def test_equals_the_oracle_in_value_and_every_gradient(name: str):
    oracle = load_oracle(name)
    image, alpha, footprint = blended_alone(
        oracle.gaussians, oracle.channels, oracle.camera, oracle.background, oracle.options
    )
    arrays = oracle.arrays
    assert_equal_up_to_rounding(image, arrays["img"], "image")
    assert_equal_up_to_rounding(alpha[..., 0], arrays["alpha"], "alpha")
    drawn = footprint.visible
    assert_equal_up_to_rounding(footprint.means2d[drawn], arrays["means2d"][drawn], "means2d")
    assert torch.equal(footprint.radii.long(), arrays["radii"].long())

    ((image * arrays["in_v_img"]).sum() + (alpha[..., 0] * arrays["in_v_alpha"]).sum()).backward()
    for key, leaf in oracle.leaves.items():
        assert_equal_up_to_rounding(leaf.grad, arrays[f"g_{key}"], f"gradient of {key}")
    assert_equal_up_to_rounding(footprint.means2d_gradient, arrays["g_means2d"], "gradient of means2d")
    assert_equal_up_to_rounding(footprint.absolute_gradient, arrays["absgrad_means2d"], "absolute gradient")


def smooth_scene() -> tuple[Gaussians, Tensor, Camera]:
    """Five soft Gaussians, wider than the 6 x 5 image: between 4 and 60 percent opaque at every pixel.

    So no alpha comes near 1/255 or the clamp, and the transmittance stays far above 1e-4: rendering is smooth here.
    """
    generator = torch.Generator().manual_seed(3)
    draw = lambda *shape: torch.randn(*shape, generator=generator, dtype=torch.float64)  # noqa: E731
    means = draw(5, 3) * 0.2 + torch.tensor([0.0, 0.0, 3.0])
    # Distinct depths, further apart than a difference step.
    means[:, 2] = torch.tensor([2.6, 2.8, 3.0, 3.2, 3.4])
    gaussians = Gaussians(means, draw(5, 3) * 0.2 - 0.3, draw(5, 4), draw(5) * 0.5 - 0.7)
    camera = Camera(torch.eye(4, dtype=torch.float64), (5.0, 6.0), (3.3, 2.1), 6, 5)
    return gaussians, draw(5, 2), camera


@pytest.mark.parametrize("antialiased", [False, True])
def test_gradients_equal_finite_differences(antialiased: bool):
    gaussians, channels, camera = smooth_scene()
    options = RasterOptions(antialiased=antialiased)
    background, factor = torch.tensor([0.3, -0.2], dtype=torch.float64), torch.full((5,), 0.8, dtype=torch.float64)

    def image_and_alpha(means, log_scales, quats, opacity_logits, channels, factor):
        table = Gaussians(means, log_scales, quats, opacity_logits)
        image, alpha, _ = blended_alone(table, channels, camera, background, options, factor)
        return torch.cat([image, alpha], -1)

    inputs = [*gaussians.columns().values(), channels, factor]
    leaves = [leaf.requires_grad_() for leaf in inputs]
    # Undefined gradients never reach the footprint's hook: a training step always asks for the centres'.
    assert torch.autograd.gradcheck(image_and_alpha, leaves, check_undefined_grad=False)


def test_float32_is_close_to_float64():
    gaussians, channels, camera = smooth_scene()
    single = Gaussians(*(column.float() for column in gaussians.columns().values()))
    exact = drawn(ReferenceRasterizer(), gaussians, channels, camera, torch.zeros(2, dtype=torch.float64))
    rounded = drawn(ReferenceRasterizer(), single, channels.float(), camera, torch.zeros(2))
    assert rounded.image.dtype == torch.float32
    torch.testing.assert_close(rounded.image.double(), exact.image, rtol=0, atol=1e-5)


def test_gradients_of_a_second_backward_replace_those_of_the_first():
    gaussians, channels, camera = smooth_scene()
    gaussians.means.requires_grad_()
    options = RasterOptions(absgrad=True)
    background = torch.zeros(2, dtype=torch.float64)
    image, _, footprint = blended_alone(gaussians, channels, camera, background, options)
    assert footprint.means2d_gradient is None
    image.sum().backward(retain_graph=True)
    first = footprint.means2d_gradient, footprint.absolute_gradient
    image.sum().backward()
    assert torch.equal(footprint.means2d_gradient, first[0])
    assert torch.equal(footprint.absolute_gradient, first[1])
