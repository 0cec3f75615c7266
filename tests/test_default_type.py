"""Arrays for the kernels are float32 whatever torch makes by default."""

import torch

from ringlight.color.ring_kernel import Workspace
from ringlight.color.visibility_mask import straight_through_mask
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_at
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.measure.metrics import ssim_same
from ringlight.rasterize.cpu import CpuRasterizer


def all_results() -> list[torch.Tensor]:
    """Of each caller of the kernels that makes arrays; forward and backward, float32."""
    draw = torch.Generator().manual_seed(0)
    single = lambda *shape: torch.randn(*shape, generator=draw, dtype=torch.float32).requires_grad_()  # noqa: E731
    table = Gaussians(single(9, 3), single(9, 3), single(9, 4), single(9))
    channels, logits, rows = single(9, 3), single(9), single(2, 5, 4).detach()
    pose = torch.eye(4, dtype=torch.float32)
    pose[2, 3] = 4
    camera = Camera(pose, (9.0, 9.0), (6.0, 5.0), 12, 10)
    factor = straight_through_mask(logits, 0.3)[:, 0]
    raster = CpuRasterizer()(table, channels, camera, torch.ones(3), opacity_factor=factor)
    target = Target(torch.rand(3, 10, 12, generator=draw, dtype=torch.float32))
    value, by_image = photometric_gradient(raster.image, target, PhotometricLoss())
    raster.image.backward(by_image)
    heads = PerceptronStack(2, (4, 6, 6, 3), draw).to(torch.float32)
    at_nodes = stack_at(heads, rows)
    at_nodes.sum().backward()
    light = Workspace().floats(7)
    footprint = [raster.footprint.means2d, raster.footprint.radii]
    gradients = [channels.grad, logits.grad, heads.weights[0].grad]
    results = [raster.image, raster.alpha, *footprint, value, at_nodes, light, *gradients]
    assert ssim_same(raster.image, raster.image) == 1
    return [result.detach() for result in results]


def test_torchs_default_type_changes_nothing():
    torch.set_default_dtype(torch.float64)
    try:
        results = all_results()
    finally:
        torch.set_default_dtype(torch.float32)
    assert all(result.dtype == torch.float32 for result in results)
