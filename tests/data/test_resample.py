"""Colours between pixels: splines, in strips, with alpha."""

import numpy as np
import pytest
from scipy import ndimage

from ringlight.data import resample
from ringlight.data.resample import resampled


def noise(width: int, height: int, channels: int) -> np.ndarray:
    return np.random.default_rng(7).integers(0, 256, (height, width, channels), dtype=np.uint8)


def grid(width: int, height: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)


@pytest.mark.parametrize("size", [(31, 22), (1, 1), (2, 1), (1, 9)])
@pytest.mark.parametrize("channels", [3, 4])
def test_at_its_own_pixels_a_photograph_is_itself(size: tuple[int, int], channels: int):
    pixels = noise(*size, channels)
    if channels == 4:
        pixels[..., 3] = np.where(pixels[..., 3] < 60, 0, 255)
        pixels[pixels[..., 3] == 0] = 0  # hidden colours are not kept
    assert (resampled(pixels, lambda first, last: np.moveaxis(grid(*size)[first:last], -1, 0), *size) == pixels).all()


def test_strips_and_precision_change_nothing(monkeypatch: pytest.MonkeyPatch):
    pixels = noise(60, 41, 3)
    places = grid(50, 37) * [60 / 50, 41 / 37] + 0.3 * np.sin(grid(50, 37))

    def strip(first: int, last: int) -> np.ndarray:
        return np.moveaxis(places[first:last], -1, 0)

    at_once = resampled(pixels, strip, 50, 37)
    monkeypatch.setattr(resample, "POINTS_AT_ONCE", 120)
    assert (resampled(pixels, strip, 50, 37) == at_once).all()
    at = [places[..., 1] - 0.5, places[..., 0] - 0.5]
    slow = [
        ndimage.map_coordinates(plane.astype(float), at, order=3, mode="mirror") for plane in pixels.T.swapaxes(1, 2)
    ]
    assert np.abs(np.clip(np.stack(slow, -1), 0, 255) - at_once).max() <= 0.51
