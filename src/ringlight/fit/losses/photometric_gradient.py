"""Photometric loss: pixel term + structural similarity, by kernels on the CPU and on a GPU, by torch elsewhere.

SSIM is that of 3DGS: Wang et al. 2004 with an 11 x 11 Gaussian window of sigma 1.5, zeros beyond the border, K1 = 0.01,
K2 = 0.03, range 1, averaged over pixels and channels. The rendering is compared as it is, not clamped.
"""

import functools

import torch
import torch.nn.functional
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.triton_kernels import runs_triton
from ringlight.fit.photometric import PhotometricLoss

WINDOW = 11
SIGMA = 1.5
C1 = 0.01**2
C2 = 0.03**2


class Target:
    """A photograph to compare with, and its blurs, which do not change while training.

    ``image`` [3 H W] float32 in [0, 1], planar; ``blur`` and ``square_blur`` are the windowed means of it and of its
    square, empty where torch compares. 36 bytes a pixel.
    """

    def __init__(self, image: Float[Tensor, "3 H W"]):
        self.image = image.detach().to(torch.float32).contiguous()
        self.blur = self.square_blur = self.image.new_empty(0)
        if image.device.type == "cpu":
            # One block: as three arrays a hundred photographs of 400 x 400 pixels left the heap 80 to 200 MB larger.
            block = torch.stack((self.image, self.image, self.image))
            self.image, self.blur, self.square_blur = block.unbind()
            _kernels.blur_target(self.image, self.blur, self.square_blur, _workspace(self.image))
        elif runs_triton(self.image):
            self.blur, self.square_blur = target_blurs(self.image)


def photometric_gradient(
    color: Float[Tensor, "H W 3"], target: Target, settings: PhotometricLoss
) -> tuple[Float[Tensor, ""], Float[Tensor, "H W 3"]]:
    """The loss and its gradient with respect to ``color``, both without a graph.

    One pass gives both, so a step begins its way back with the gradient. ``color`` is used in place when its
    memory is planar ([3 H W] permuted), as rasterizers return it, and copied otherwise; the gradient is planar too. The
    kernels want float32; anything else takes the torch path. Raises ValueError where the sizes differ.
    """
    if color.shape[:2] != target.image.shape[1:]:
        sizes = f"{tuple(color.shape[:2])} and {tuple(target.image.shape[1:])}"
        raise ValueError(f"rendering and target differ in height and width: {sizes}")
    if color.device.type == "cpu" and color.dtype == torch.float32:
        return _native_gradient(color.detach(), target, settings)
    if runs_triton(color, target.image):
        return _triton_gradient(color.detach(), target, settings)
    leaf = color.detach().requires_grad_()
    with torch.enable_grad():
        value = photometric_reference(leaf.permute(2, 0, 1), target.image.to(color), settings)
    return value.detach(), torch.autograd.grad(value, leaf)[0]


def _native_gradient(color: Tensor, target: Target, settings: PhotometricLoss) -> tuple[Tensor, Tensor]:
    image = color.permute(2, 0, 1).contiguous()
    value, gradient = image.new_empty(()), torch.empty_like(image)
    _kernels.photometric(
        image,
        target.image,
        target.blur,
        target.square_blur,
        gradient,
        _workspace(image),
        pixel_weight=settings.scale * (1 - settings.ssim_weight),
        ssim_weight=settings.scale * settings.ssim_weight,
        squared=settings.pixel == "l2",
        value=value,
    )
    return value, gradient.permute(1, 2, 0)


def _triton_gradient(color: Tensor, target: Target, settings: PhotometricLoss) -> tuple[Tensor, Tensor]:
    from ringlight.fit.losses.photometric_triton import photometric_by_triton

    return photometric_by_triton(
        color, target.image, target.blur, target.square_blur, window_weights(color.dtype, color.device), (C1, C2),
        pixel_weight=settings.scale * (1 - settings.ssim_weight),
        ssim_weight=settings.scale * settings.ssim_weight,
        squared=settings.pixel == "l2",
    )  # fmt: skip


def _workspace(image: Tensor) -> Tensor:
    _, height, width = image.shape
    return image.new_empty(_kernels.photometric_workspace(height, width, _kernels.threads()))


def photometric_reference(
    planar: Float[Tensor, "3 H W"], target: Float[Tensor, "3 H W"], settings: PhotometricLoss
) -> Float[Tensor, ""]:
    """The same loss in plain torch, on any device and in any precision: the reference of the kernels."""
    difference = planar - target
    pixel = difference.abs().mean() if settings.pixel == "l1" else difference.square().mean()
    dissimilarity = 1 - ssim_map(planar, target).mean()
    return settings.scale * ((1 - settings.ssim_weight) * pixel + settings.ssim_weight * dissimilarity)


def ssim_map(first: Float[Tensor, "C H W"], second: Float[Tensor, "C H W"]) -> Float[Tensor, "C H W"]:
    """SSIM of the window around each pixel, zeros beyond the border."""
    moments = torch.stack((first, second, first * first, second * second, first * second))
    mean1, mean2, square1, square2, product = _blur(moments)
    variance1, variance2 = square1 - mean1 * mean1, square2 - mean2 * mean2
    covariance = product - mean1 * mean2
    luminance = (2 * mean1 * mean2 + C1) / (mean1 * mean1 + mean2 * mean2 + C1)
    return luminance * (2 * covariance + C2) / (variance1 + variance2 + C2)


def target_blurs(image: Float[Tensor, "3 H W"]) -> tuple[Float[Tensor, "3 H W"], Float[Tensor, "3 H W"]]:
    """Windowed means of a photograph and of its square, zeros beyond the border."""
    blur, square_blur = _blur(torch.stack((image, image * image)))
    return blur.contiguous(), square_blur.contiguous()


@functools.lru_cache(maxsize=4)
def window_weights(dtype: torch.dtype, device: torch.device) -> Float[Tensor, "11"]:
    """The Gaussian window along one axis; its sum is one."""
    offsets = torch.arange(WINDOW, dtype=dtype, device=device) - WINDOW // 2
    weights = torch.exp(-offsets.square() / (2 * SIGMA**2))
    return weights / weights.sum()


def _blur(images: Float[Tensor, "B C H W"]) -> Float[Tensor, "B C H W"]:
    weights = window_weights(images.dtype, images.device)
    single = images.flatten(0, 1)[:, None]
    down = torch.nn.functional.conv2d(single, weights[None, None, :, None], padding=(WINDOW // 2, 0))
    both = torch.nn.functional.conv2d(down, weights[None, None, None, :], padding=(0, WINDOW // 2))
    return both.view_as(images)
