"""The loss's Triton kernels against the reference, in value and gradient."""

import pytest
import torch

import interpreted
from ringlight.fit.losses import photometric_gradient as losses
from ringlight.fit.losses.photometric_triton import photometric_by_triton
from ringlight.fit.photometric import PhotometricLoss


@pytest.mark.parametrize("size", [(1, 1), (5, 7), (13, 30), (40, 37)])
@pytest.mark.parametrize("pixel", ["l1", "l2"])
@pytest.mark.parametrize("memory", ["planar", "interleaved", "part of more channels"])
def test_equals_the_reference(size: tuple[int, int], pixel: str, memory: str):
    generator = torch.Generator().manual_seed(size[1])
    color, target = (torch.rand(3, *size, generator=generator).to(interpreted.DEVICE) for _ in range(2))
    color[1, 0, 0] = target[1, 0, 0]  # where the difference is zero its slope is too
    settings = PhotometricLoss(pixel=pixel, ssim_weight=0.3, scale=2.0)
    leaf = color.double().requires_grad_()
    expected = losses.photometric_reference(leaf, target.double(), settings)
    expected.backward()
    seen = color.permute(1, 2, 0)
    if memory != "planar":
        seen = torch.cat([seen, seen], -1)[..., :3] if memory == "part of more channels" else seen.contiguous()
    blurs = losses.target_blurs(target)
    value, gradient = photometric_by_triton(
        seen, target, *blurs, losses.window_weights(target.dtype, target.device), (losses.C1, losses.C2),
        settings.scale * 0.7, settings.scale * 0.3, pixel == "l2",
    )  # fmt: skip
    assert gradient.stride() == (seen.contiguous() if memory == "part of more channels" else seen).stride()
    assert value.item() == pytest.approx(expected.item(), rel=1e-5)
    tolerance = 1e-5 * leaf.grad.abs().max().item()
    torch.testing.assert_close(gradient.permute(2, 0, 1).double(), leaf.grad, rtol=0, atol=tolerance)
