"""PSNR and SSIM, each with its convention in its name; papers differ in both.

Images are [H W 3] in [0, 1]; renderings are clamped to that range first. A perfect picture has PSNR ``math.inf``:
writers of JSON must say so in their own way. Everything is computed on the CPU.
"""

import math
from collections.abc import Sequence
from statistics import fmean

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels

C1 = 0.01**2
C2 = 0.03**2
"""Constants of SSIM for a dynamic range of 1 (Wang et al. 2004)."""

WINDOW_REACH = 5
"""The Gaussian window has 11 x 11 pixels, sigma 1.5."""

LEVELS = 255


def mean_squared_error(image: Float[Tensor, "*pixels 3"], truth: Float[Tensor, "*pixels 3"]) -> float:
    """Over all pixels and channels, summed in double precision."""
    return (image.clamp(0, 1).double() - truth.double()).square().mean().item()


def psnr(
    image: Float[Tensor, "*pixels 3"],
    truth: Float[Tensor, "*pixels 3"],
    weights: Float[Tensor, "*pixels"] | None = None,
) -> float:
    """Peak signal-to-noise ratio in dB of one image, from the mean over pixels and channels, without rounding. Pixels
    that were not drawn evenly have ``weights`` in it."""
    if weights is None:
        return _decibel(mean_squared_error(image, truth))
    squares = (image.clamp(0, 1).double() - truth.double()).square().mean(-1)
    return _decibel((squares * weights.to(squares)).mean().item())


def psnr_u8(image: Float[Tensor, "*pixels 3"], truth: Float[Tensor, "*pixels 3"]) -> float:
    """PSNR in dB after both were rounded to 8 bit, as 3DGS's evaluation of saved pictures does."""
    return psnr(_rounded(image), _rounded(truth))


def psnr_pooled(errors: Sequence[float]) -> float:
    """PSNR in dB of the mean of all images' mean squared errors (one or more): never above the mean of their PSNRs."""
    return _decibel(fmean(errors))


def psnr_of_different(values: Sequence[float]) -> float:
    """Mean of images' PSNRs in dB (one or more) over those that differ: infinite only where none does."""
    return fmean([value for value in values if math.isfinite(value)] or values)


def ssim_same_and_valid(image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> tuple[float, float]:
    """Structural similarity by both conventions, from one map.

    Same: over every pixel, zeros beyond the border, as 3DGS. Valid: where the window fits into the image, as the NeRF
    papers; NaN for an image that is smaller than the window, 11 pixels.
    """
    similarity = _ssim_map(image, truth)
    inner = slice(WINDOW_REACH, -WINDOW_REACH)
    return similarity.mean().item(), similarity[:, inner, inner].mean().item()


def _decibel(squared_error: float) -> float:
    return math.inf if squared_error == 0 else -10 * math.log10(squared_error)


def _rounded(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    return (image.clamp(0, 1) * LEVELS).round() / LEVELS


def _ssim_map(image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> Float[Tensor, "3 H W"]:
    """All five moments go through the same blur, so that equal images score exactly 1."""
    x, y = (picture.detach().cpu().float().clamp(0, 1).permute(2, 0, 1) for picture in (image, truth))
    mean_x, mean_y, xx, yy, xy = _blur(torch.cat((x, y, x * x, y * y, x * y))).double().unflatten(0, (5, 3))
    luminance = (2 * mean_x * mean_y + C1) / (mean_x * mean_x + mean_y * mean_y + C1)
    contrast = 2 * (xy - mean_x * mean_y) + C2
    return luminance * contrast / ((xx - mean_x * mean_x) + (yy - mean_y * mean_y) + C2)


def _blur(planes: Float[Tensor, "C H W"]) -> Float[Tensor, "C H W"]:
    blurred, unused = torch.empty_like(planes), torch.empty_like(planes)
    _, height, width = planes.shape
    workspace = planes.new_empty(_kernels.photometric_workspace(height, width, _kernels.threads()))
    _kernels.blur_target(planes, blurred, unused, workspace)
    return blurred
