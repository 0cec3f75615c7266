"""The error map's colours: ordered for the eye, exact at the ends."""

import numpy as np

from ringlight.measure.colormap import ember


def lightness(colors):
    """CIELAB L* of sRGB in 0..255."""
    channels = colors / 255
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    return np.where(luminance > (6 / 29) ** 3, 116 * np.cbrt(luminance) - 16, luminance * 903.3)


def test_lightness_rises_evenly_from_black_to_paper():
    ramp = ember(np.linspace(0, 1, 101)[None])[0]
    steps = np.diff(lightness(ramp.astype(float)))
    assert (steps > 0).all()
    assert steps.max() < 2.2 * steps.mean()
    assert lightness(ramp[0].astype(float)) < 5
    assert lightness(ramp[-1].astype(float)) > 95


def test_values_beyond_the_scale_take_its_ends():
    colors = ember(np.array([[-1.0, 0.0, 1.0, 7.0, np.nan, np.inf]]))[0]
    assert (colors[0] == colors[1]).all()
    assert (colors[2:] == colors[2]).all()
