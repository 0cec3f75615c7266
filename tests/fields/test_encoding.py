import math

import torch

from ringlight.fields.encoding import encoded_width, fourier_features


def test_columns_are_values_then_sines_then_cosines():
    values = torch.tensor([[0.25, -0.5]], dtype=torch.float64)
    encoded = fourier_features(values, 2)[0]
    expected = [0.25, -0.5]
    for value in (0.25, -0.5):
        expected += [math.sin(math.pi * value), math.sin(2 * math.pi * value)]
        expected += [math.cos(math.pi * value), math.cos(2 * math.pi * value)]
    assert encoded.shape == (encoded_width(2, 2),)
    torch.testing.assert_close(encoded, torch.tensor(expected, dtype=torch.float64))


def test_no_bands_leave_the_values():
    values = torch.rand(4, 3)
    assert torch.equal(fourier_features(values, 0), values)


def test_widths_of_the_paper():
    assert encoded_width(1, 10) == 21
    assert encoded_width(3, 10) == 63
