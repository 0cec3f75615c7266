"""The kernels timed alone do what the step does; pairs and their operations are counted right."""

import pytest
import torch

from ringlight import _kernels
from ringlight.bench.flops import Pairs
from ringlight.bench.kernels_alone import AdamKernel, LossKernel, RasterKernel, gradients_like
from ringlight.bench.workload import Size, workload, workload_camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.fit.losses import Target, photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, Rate
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu import CpuRasterizer
from torch_graph import drawn


@pytest.mark.parametrize("options", [RasterOptions(), RasterOptions(antialiased=True, absgrad=True)])
def test_image_and_gradients_are_the_rasterizers(options):
    work = workload(Size(300, 40))
    factor = torch.linspace(0.2, 1, 300)
    leaves = {name: getattr(work.gaussians, name).clone().requires_grad_() for name in GEOMETRY}
    table, white = Gaussians.from_columns(leaves), torch.ones(3)
    raster = drawn(CpuRasterizer(), table, work.channels, work.camera, white, options, factor)
    upstream = torch.randn(3, 40, 40, generator=torch.Generator().manual_seed(0))
    raster.image.backward(upstream.permute(1, 2, 0))
    alone = RasterKernel(work.gaussians, work.channels, work.camera, torch.ones(3), options, factor)
    alone.forward()
    alone.backward(upstream)
    assert torch.equal(alone.image, raster.image.detach().permute(2, 0, 1))
    for name, leaf in leaves.items():
        assert torch.equal(alone.gradients[name], leaf.grad), name


def test_the_loss_is_the_steps():
    image = torch.rand(3, 30, 20, generator=torch.Generator().manual_seed(0))
    target, settings = Target(torch.rand(3, 30, 20, generator=torch.Generator().manual_seed(1))), PhotometricLoss()
    value, gradient = photometric_gradient(image.permute(1, 2, 0), target, settings)
    alone = LossKernel(image, target, settings)
    assert alone.run() == pytest.approx(value.item())
    assert torch.equal(alone.gradient, gradient.permute(2, 0, 1))


def test_adam_alone_leaves_the_parameters():
    parameters = {"a": torch.ones(5, 3), "b": torch.ones(4)}
    gradients = gradients_like(parameters, {"a": torch.full((5, 3), 2.0)})
    assert gradients[0][0, 0] == 2
    assert gradients[1].shape == (4,)
    AdamKernel(list(parameters.values()), gradients, [Adam(Rate.constant(0.1))] * 2).run()
    assert all(torch.equal(parameter, torch.ones_like(parameter)) for parameter in parameters.values())


def one_wide_gaussian(opacity_logit: float, count: int = 1) -> Gaussians:
    """Covers every pixel of a small image seen from the workload's distance."""
    return Gaussians(
        torch.zeros(count, 3),
        torch.full((count, 3), 3.0),
        torch.tensor([1.0, 0, 0, 0]).repeat(count, 1),
        torch.full((count,), opacity_logit),
    )


@pytest.mark.parametrize("side", [48, 45, 33, 1])
def test_a_gaussian_on_every_pixel_makes_that_many_pairs(side: int):
    """Whole blocks of 4 x 4 lanes are evaluated; only pixels of the image are blended."""
    kernel = RasterKernel(one_wide_gaussian(0.0), torch.ones(1, 3), workload_camera(side), torch.zeros(3))
    lanes = (side + 3) // 4 * 4
    assert kernel.count_pairs() == (lanes * lanes, side * side)


def test_what_lies_behind_finished_pixels_is_not_a_pair():
    """Opacities of 0.9: the fourth would leave 1e-4 of the light, which is the threshold, so three are blended."""
    logit = torch.tensor(0.9).logit().item()
    kernel = RasterKernel(one_wide_gaussian(logit, 600), torch.ones(600, 3), workload_camera(32), torch.zeros(3))
    evaluated, blended = kernel.count_pairs()
    alphas = 1 - kernel.image[0]  # what the background would get
    assert blended == 32 * 32 * round(float(alphas.mean().log10() / -1))
    assert 32 * 32 * 4 <= evaluated <= 32 * 32 * 8


def test_pairs_without_a_forward_pass_are_refused():
    with pytest.raises(ValueError, match="no forward pass"):
        _kernels.Workspace().count_pairs()


def test_more_channels_and_pairs_cost_more():
    assert Pairs(0, 0).flops(3) == 0
    assert Pairs(100, 10).flops(3) == 100 * 46 + 10 * (9 + 32)
    assert Pairs(100, 10).flops(4) > Pairs(100, 10).flops(3)


@pytest.mark.parametrize("rounds", [0, 1, 4])
def test_the_peak_counts_the_operations_that_it_does(rounds: int):
    """Every number is a chain of its own: x/2 + 1, n times, is 2 + (x - 2) / 2^n. All sums are exact in float32."""
    sums = torch.full((3,), torch.nan)
    done = _kernels.multiply_adds(rounds, sums)
    numbers = _kernels.multiply_adds(1, torch.empty(1)) / 2
    assert numbers >= 16
    assert done == 2 * numbers * rounds * len(sums)
    expected = 2 * numbers + (numbers * (numbers - 1) / 2 - 2 * numbers) / 2**rounds
    assert sums.tolist() == [expected] * 3
