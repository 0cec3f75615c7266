"""Arrays for the kernels are float32 whatever torch makes by default."""

import torch

from ringlight.color.ring_kernel import Workspace
from ringlight.color.visibility_mask import mask_factor, mask_gradient
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_at, stack_gradients
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.measure.metrics import ssim_same_and_valid
from ringlight.rasterize.cpu import CpuRasterizer


def all_results() -> list[torch.Tensor]:
    """Of each caller of the kernels that makes arrays; forward and backward, float32."""
    draw = torch.Generator().manual_seed(0)
    single = lambda *shape: torch.randn(*shape, generator=draw, dtype=torch.float32)  # noqa: E731
    table = Gaussians(single(9, 3), single(9, 3), single(9, 4), single(9))
    channels, logits, rows = single(9, 3), single(9), single(2, 5, 4)
    pose = torch.eye(4, dtype=torch.float32)
    pose[2, 3] = 4
    camera = Camera(pose, (9.0, 9.0), (6.0, 5.0), 12, 10)
    emission = Emission({"rgb": 3}, channels, mask_factor(logits, 0.3))
    raster = CpuRasterizer().draw(table, emission, camera, torch.ones(3), want=Want.GRADIENTS)
    target = Target(torch.rand(3, 10, 12, generator=draw, dtype=torch.float32))
    value, grad_image = photometric_gradient(raster.image, target, PhotometricLoss())
    into = Gradients()
    grad_channels, grad_factor = raster.backward(grad_image, None, into)
    heads = PerceptronStack(2, (4, 6, 6, 3), draw).to(torch.float32)
    at_nodes = stack_at(heads, rows)
    of_heads = stack_gradients(heads, rows, torch.ones_like(at_nodes))
    light = Workspace().floats(7)
    footprint = [raster.footprint.means2d, raster.footprint.radii, raster.footprint.means2d_gradient]
    gradients = [grad_channels, mask_gradient(logits, grad_factor), *into.values(), *of_heads.values()]
    results = [raster.image, raster.alpha, *footprint, value, at_nodes, light, *gradients]
    assert ssim_same_and_valid(raster.image, raster.image)[0] == 1
    return results


def test_torchs_default_type_changes_nothing():
    torch.set_default_dtype(torch.float64)
    try:
        results = all_results()
    finally:
        torch.set_default_dtype(torch.float32)
    assert all(result.dtype == torch.float32 for result in results)
