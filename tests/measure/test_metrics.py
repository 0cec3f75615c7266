import math

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import correlate1d
from scipy.signal import convolve2d

from ringlight.measure.metrics import (
    mean_squared_error,
    psnr,
    psnr_of_different,
    psnr_pooled,
    psnr_u8,
    ssim_same_and_valid,
)

WEIGHTS = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
WEIGHTS /= WEIGHTS.sum()


def pair(height: int, width: int, seed: int, noise: float = 0.2) -> tuple[torch.Tensor, torch.Tensor]:
    generator = np.random.default_rng(seed)
    truth = generator.random((height, width, 3))
    truth[: height // 3] = 1
    image = (truth + noise * generator.standard_normal(truth.shape)).clip(0, 1)
    return torch.tensor(image, dtype=torch.float32), torch.tensor(truth, dtype=torch.float32)


def ssim_by_scipy(image: torch.Tensor, truth: torch.Tensor) -> np.ndarray:
    """SSIM map [H W 3] in double precision, zeros beyond the border."""

    def blur(a):
        return correlate1d(correlate1d(a, WEIGHTS, axis=0, mode="constant"), WEIGHTS, axis=1, mode="constant")

    x, y = image.double().numpy(), truth.double().numpy()
    mx, my = blur(x), blur(y)
    vx, vy, cov = blur(x * x) - mx**2, blur(y * y) - my**2, blur(x * y) - mx * my
    return (2 * mx * my + 1e-4) * (2 * cov + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))


@given(height=st.integers(11, 60), width=st.integers(11, 60), seed=st.integers(0, 2**31))
@settings(max_examples=30)
def test_ssim_is_that_of_scipy(height, width, seed):
    image, truth = pair(height, width, seed)
    expected = ssim_by_scipy(image, truth)
    same, valid = ssim_same_and_valid(image, truth)
    assert same == pytest.approx(expected.mean(), abs=2e-6)
    assert valid == pytest.approx(expected[5:-5, 5:-5].mean(), abs=1e-5)


def test_valid_means_the_windows_inside_the_image():
    image, truth = pair(20, 31, seed=1)
    window = np.outer(WEIGHTS, WEIGHTS)
    scores = []
    for channel in range(3):
        x, y = image[..., channel].double().numpy(), truth[..., channel].double().numpy()
        mx, my, xx, yy, xy = (convolve2d(a, window, mode="valid") for a in (x, y, x * x, y * y, x * y))
        structure = (2 * (xy - mx * my) + 9e-4) / (xx - mx**2 + yy - my**2 + 9e-4)
        scores.append(((2 * mx * my + 1e-4) / (mx**2 + my**2 + 1e-4) * structure).mean())
    assert ssim_same_and_valid(image, truth)[1] == pytest.approx(np.mean(scores), abs=1e-5)


@given(seed=st.integers(0, 2**31))
@example(seed=10518)  # has a value that float32 and float64 round to different bytes
@settings(max_examples=20)
def test_psnr_is_that_of_numpy(seed):
    image, truth = pair(13, 17, seed)
    x, y = image.double().numpy(), truth.double().numpy()
    assert psnr(image, truth) == pytest.approx(-10 * np.log10(np.mean((x - y) ** 2)))
    x8, y8 = (np.rint(picture.numpy() * np.float32(255)).astype(np.float64) for picture in (image, truth))
    assert psnr_u8(image, truth) == pytest.approx(20 * np.log10(255) - 10 * np.log10(np.mean((x8 - y8) ** 2)))


def test_equal_images_are_perfect():
    _, truth = pair(30, 40, seed=2)
    assert psnr(truth, truth) == math.inf
    assert psnr_u8(truth, truth) == math.inf
    assert psnr_pooled([0.0, 0.0]) == math.inf
    assert ssim_same_and_valid(truth, truth) == (1, 1)


def test_renderings_are_clamped():
    image, truth = pair(12, 12, seed=3)
    wild = image + torch.where(image == 1, 5.0, 0.0) - torch.where(image == 0, 5.0, 0.0)
    for metric in (psnr, psnr_u8, ssim_same_and_valid):
        assert metric(wild, truth) == metric(image, truth)


def test_pooled_psnr_is_below_the_mean():
    errors = [mean_squared_error(*pair(16, 16, seed=4, noise=noise)) for noise in (0.01, 0.1, 0.4)]
    assert psnr_pooled(errors) == pytest.approx(-10 * math.log10(sum(errors) / 3))
    assert psnr_pooled(errors) < sum(-10 * math.log10(error) for error in errors) / 3


def test_a_perfect_image_does_not_hide_what_the_others_lose():
    assert psnr_of_different([math.inf, 50.0, 60.0]) == 55.0
    assert psnr_of_different([math.inf, math.inf]) == math.inf


def test_pooling_nothing_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        psnr_pooled([])


def test_an_image_below_the_window_has_no_valid_ssim():
    image, truth = pair(10, 30, seed=5)
    same, valid = ssim_same_and_valid(image, truth)
    assert math.isnan(valid)
    assert math.isfinite(same)


def test_memory_layout_does_not_matter():
    image, truth = pair(25, 18, seed=6)
    planar = image.permute(2, 0, 1).contiguous().permute(1, 2, 0)
    assert ssim_same_and_valid(planar, truth) == ssim_same_and_valid(image, truth)
    assert psnr(planar, truth) == pytest.approx(psnr(image, truth))
